"""
Pytest plugin: the fixture ``servo_run``, and the option for the plots of failed checks.

Pytest loads it in every session of an environment that has this package, so that it imports only pytest.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from hdd_servo_ros.testing.run import Run


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--servo-plots``."""
    parser.getgroup('hdd_servo_ros').addoption(
        '--servo-plots',
        metavar='DIR',
        help='directory for the plots of failed checks of runs (default: the directory of the run)',
    )


@pytest.fixture(scope='session')
def servo_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """
    Make runs of the servo bench: ``servo_run('params.yaml', controller='pid', overrides={...}, without_ros=True)``.

    Parameter files overlay from left to right. It returns the opened :class:`hdd_servo_ros.Run` and takes the keywords
    of :func:`hdd_servo_ros.testing.experiment.make_run`. Its scope is the session, so that fixtures of any scope can
    share a run between tests.
    """
    from hdd_servo_ros.testing import checks
    from hdd_servo_ros.testing.experiment import make_run

    directory = request.config.getoption('--servo-plots')
    checks.plot_directory = Path(directory).resolve() if directory else None

    def run(*parameter_files: str | Path, **options: Any) -> Run:
        return make_run(parameter_files, tmp_path_factory.mktemp('servo_run') / 'run', **options)

    return run
