"""The undisturbed run of which every other one of the same parameters is a part."""

import contextlib
import functools
import io
import tempfile
from pathlib import Path

from faults.processes import PARAMS
from hdd_servo_ros import Run
from hdd_servo_ros.simulation.simulate import main

LENGTH = '3.0'
"""Longer than any run of a trial comes [s]."""


@functools.cache
def reference_run(where: Path) -> Run:
    """Return it, made once, in a folder of one that is there."""
    folder = Path(tempfile.mkdtemp(prefix='reference-', dir=where)) / 'run'
    return Run.open(simulated(folder, '-p', f'duration:={LENGTH}'))


def simulated(folder: Path, *arguments: str) -> Path:
    """Record a run of the default parameters without middleware."""
    given = ['--ros-args', '--params-file', str(PARAMS), '-p', f'run_dir:={folder}', '-p', 'plot:=false', *arguments]
    printed = io.StringIO()
    # Not judged by its time: the first one of a copy of the package compiles the kernels.
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(given)
    if code != 0:
        raise RuntimeError(f'the undisturbed run has failed: {printed.getvalue()}')
    return folder
