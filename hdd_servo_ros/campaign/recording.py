"""Makes runs that are recorded in this process, by `simulate`, with what it prints in a file."""

import contextlib
import dataclasses
import shutil
from pathlib import Path

from hdd_servo_ros.campaign.worker import end_if_signaled


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    A run to record, all that a worker needs to make it.

    Attributes
    ----------
    arguments
        Of `simulate`.
    directory
        Folder of the run, as the arguments have it. What is there is left from a worker that was killed: it goes.
    log
        Where the output goes.
    """

    arguments: tuple[str, ...]
    directory: Path
    log: Path


def record(due: Recording) -> int:
    """Make a run and record it, and return the exit code of `simulate`; its output is in the log line by line."""
    # Late: most campaigns record nothing.
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
    """Import what a run and its summary need, and load the compiled loop, so that forked workers have it."""
    import hdd_servo_ros.reporting.show
    import hdd_servo_ros.simulation.simulate  # noqa: F401
    from hdd_servo_ros.simulation.closed_loop import Controllers
    from hdd_servo_ros.simulation.experiment import Experiment

    for controller in Controllers._fields:
        Experiment(1e-4, controller).run(0, 1)
