"""`playback`: publishes the disturbance of a recorded run in another run."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.graph.roles import RECORDED_RUN
from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.run_parameters import PlaybackParameters
from hdd_servo_ros.recording.playback import Playback
from hdd_servo_ros.ros.run_plan import RunPlan


class PlaybackNode(CatalogNode):
    """
    Publisher of the recorded messages of every tick of `/clock`, byte for byte.

    Raises
    ------
    ParameterError
        If no run is given, or the run has no disturbance.
    """

    def __init__(self) -> None:
        super().__init__('playback')
        recorded_run = self.parameters[PlaybackParameters].recorded_run
        if not recorded_run:
            raise ParameterError(RECORDED_RUN, recorded_run, 'the directory of a recorded run')
        self._playback = Playback(recorded_run)
        # Only the topics that the recorded run contains.
        self.outputs = self._playback.topics

    def prepare(self, run: RunPlan) -> None:
        try:
            self._playback.check(run.sample_time, run.last_tick)
        except ParameterError as error:
            raise RunError(f'{self.get_name()}: {error}') from None

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        for output, topic in enumerate(self.outputs):
            self.publish_bytes(output, self._playback.messages(topic, tick, 1).tobytes())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('playback', PlaybackNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
