"""Assertions about recorded runs, and a pytest plugin that makes runs; see ``docs/howto/test-with-pytest.md``."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.testing.checks import CheckFailed, Checks
    from hdd_servo_ros.testing.experiment import ExperimentFailed, make_run
    from hdd_servo_ros.testing.run import Run

__all__ = [
    'CheckFailed',
    'Checks',
    'ExperimentFailed',
    'Run',
    'make_run',
]

__getattr__ = lazily(
    __name__,
    {
        'CheckFailed': '.checks',
        'Checks': '.checks',
        'ExperimentFailed': '.experiment',
        'Run': '.run',
        'make_run': '.experiment',
    },
)
