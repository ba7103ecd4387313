"""The undisturbed run; every other run with the same parameters must be a part of it."""

import contextlib
import functools
import io
import tempfile
from pathlib import Path

from faults.processes import PARAMS
from hdd_servo_ros import Run
from hdd_servo_ros.simulation.simulate import main

LENGTH = '3.0'
"""Duration, longer than any run of a trial [s]."""


@functools.cache
def reference_run(where: Path) -> Run:
    """Return the undisturbed run, recorded once in a new directory below ``where``."""
    folder = Path(tempfile.mkdtemp(prefix='reference-', dir=where)) / 'run'
    return Run.open(simulated(folder, '-p', f'duration:={LENGTH}'))


def simulated(folder: Path, *arguments: str) -> Path:
    """Record a run with the default parameters by `simulate`."""
    given = ['--ros-args', '--params-file', str(PARAMS), '-p', f'run_dir:={folder}', '-p', 'plot:=false', *arguments]
    printed = io.StringIO()
    # Without a time limit: the first run of a copy of the package compiles the kernels.
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(given)
    if code != 0:
        raise RuntimeError(f'the undisturbed run failed: {printed.getvalue()}')
    return folder
