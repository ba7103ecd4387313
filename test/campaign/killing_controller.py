"""Controllers for the tests of campaigns that would end the process in the midst of a run."""

import dataclasses
import importlib
import sys

from hdd_servo_ros.parameters import ParameterSet, parameter


@dataclasses.dataclass(frozen=True)
class Nothing(ParameterSet):
    """Parameters."""

    gain: float = parameter(1.0, 'gain')


class Ending:
    """Ends the process at tick 100."""

    def __init__(self, parameters: Nothing, sample_time: float) -> None:
        pass

    def update(self, parameters: Nothing) -> None:
        """Take no parameters."""

    def step(self, inputs):
        """Return 0 V."""
        if inputs.tick == 100:
            self.leave()
        return 0.0

    def leave(self):
        """End the process."""
        sys.exit(3)


class Waiting(Ending):
    """Tells which process this is and waits at tick 100, while there is the mark ``wait``."""

    def __init__(self, parameters: Nothing, sample_time: float) -> None:
        pass

    def leave(self):
        """Wait."""
        importlib.import_module('killing_metric').wait(None)


class Interrupting(Ending):
    """Raises what Ctrl-C raises."""

    def __init__(self, parameters: Nothing, sample_time: float) -> None:
        pass

    def leave(self):
        """Raise it."""
        raise KeyboardInterrupt
