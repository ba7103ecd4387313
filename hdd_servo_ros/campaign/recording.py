"""Recorded runs by `simulate` in this process, with its output in a log file."""

import contextlib
import dataclasses
import shutil
from pathlib import Path

from hdd_servo_ros.campaign.worker import end_if_signaled


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    A run to record, with everything that a worker needs.

    Attributes
    ----------
    arguments
        Arguments of `simulate`.
    directory
        Directory of the run, as in the arguments. An existing one is the remains of a killed worker and is removed.
    log
        File for the output.
    """

    arguments: tuple[str, ...]
    directory: Path
    log: Path


def record(due: Recording) -> int:
    """Record a run, and return the exit code of `simulate`; its output goes to the log line by line."""
    # Imported late: most campaigns record nothing.
    from hdd_servo_ros.simulation import simulate

    if due.directory.exists():
        shutil.rmtree(due.directory)
    with (
        due.log.open('w', buffering=1, encoding='utf8', errors='backslashreplace') as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        code = simulate.main(due.arguments)
    end_if_signaled(code)
    return code


def prepare() -> None:
    """Import the modules of a run and its summary, and load the compiled loop, for the forked workers."""
    import hdd_servo_ros.reporting.show
    import hdd_servo_ros.simulation.simulate  # noqa: F401
    from hdd_servo_ros.simulation.closed_loop import Controllers
    from hdd_servo_ros.simulation.experiment import Experiment

    for controller in Controllers._fields:
        Experiment(1e-4, controller).run(0, 1)
