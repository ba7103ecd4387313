"""`signal_analyzer`: excites the drive with a swept sine instead of a controller, and writes the response."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer, SignalAnalyzerParameters
from hdd_servo_ros.messages.outcome import Outcome
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.reporting.response import write_response


class SignalAnalyzerNode(ControllerNode):
    """Node of the instrument :class:`SignalAnalyzer`."""

    def __init__(self) -> None:
        super().__init__('signal_analyzer')

    @property
    def trial_sample_time(self) -> float:
        # The highest frequency is checked with the sample time of the run.
        parameters: SignalAnalyzerParameters = self.parameters[SignalAnalyzerParameters]
        return min(0.1 / parameters.stop_frequency, 1.0)

    def finish(self, outcome: Outcome) -> None:
        assert isinstance(self._controller, SignalAnalyzer)
        for line in write_response(self._controller, self.run_directory):
            self.get_logger().info(line)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('signal_analyzer', SignalAnalyzerNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
