"""
The pytest plugin: the fixture ``servo_run``, and where pictures of failed checks go.

Loaded by pytest in every session of an environment that has the package: nothing but pytest is imported here.
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
        help="where pictures of failed checks of runs go (default: each run's own folder)",
    )


@pytest.fixture(scope='session')
def servo_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """
    Make runs of the servo bench: ``servo_run('params.yaml', controller='pid', overrides={...}, without_ros=True)``.

    Several parameter files overlay from left to right. Returns the opened :class:`hdd_servo_ros.Run`; the keywords are
    those of :func:`hdd_servo_ros.testing.experiment.make_run`. Of session scope, so that fixtures of any scope may
    keep a run for several tests.
    """
    from hdd_servo_ros.testing import checks
    from hdd_servo_ros.testing.experiment import make_run

    directory = request.config.getoption('--servo-plots')
    checks.plot_directory = Path(directory).resolve() if directory else None

    def run(*parameter_files: str | Path, **options: Any) -> Run:
        return make_run(parameter_files, tmp_path_factory.mktemp('servo_run') / 'run', **options)

    return run
