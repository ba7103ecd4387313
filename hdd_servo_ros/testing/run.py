"""A recorded run with assertions, for tests and scripts."""

import functools

from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.testing.checks import Checks


class Run(RecordedRun):
    """
    A recorded run, opened with :meth:`Run.open`, with assertions about it under :attr:`check`.

    Examples
    --------
    For the run of ``make simulate ARGS="-p run_dir:=runs/first -p duration:=0.3"``:

    >>> from hdd_servo_ros import Run
    >>> run = Run.open('runs/first')
    >>> run.status, run.controller, run.last_tick
    ('finished', 'adaptive_nn', 3000)
    >>> f'{1e3 * run.error[run.since(0.2)].std():.2f} nm'
    '1.48 nm'
    >>> f'{run.control.before_saturation.max():.4f} V'
    '0.1280 V'
    >>> run.parameter('reference_generator', 'frequency')  # at the last tick
    100.0
    """

    @functools.cached_property
    def check(self) -> Checks:
        """Assertions about the run, for tests; see ``docs/howto/test-with-pytest.md``."""
        return Checks(self)
