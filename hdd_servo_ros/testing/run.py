"""A recorded run that can be checked: what tests and scripts open."""

import functools

from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.testing.checks import Checks


class Run(RecordedRun):
    """A recorded run, opened with :meth:`Run.open`, with assertions about it under :attr:`check`."""

    @functools.cached_property
    def check(self) -> Checks:
        """Assertions about the run, for tests; see ``docs/bag-assertions.md``."""
        return Checks(self)
