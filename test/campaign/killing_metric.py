"""Own metrics for the tests of campaigns; one kills its worker, as a person or the kernel would, a few times."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

MARKS = 'HDD_SERVO_ROS_TEST_MARKS'
"""Folder of a file per kill that is still due."""


def late_peak(run):
    """Return the largest error of the last tenth of the run [um]."""
    return np.abs(run.error[-len(run.ticks) // 10 :]).max()


def kill_once(run):
    """Kill this process while there are marks, each of which counts once; else return 1."""
    for mark in sorted(Path(os.environ[MARKS]).iterdir()):
        try:
            mark.unlink()
        except FileNotFoundError:
            continue
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0


def kill_always(run):
    """Kill this process in the run with the largest amplitude."""
    if run.parameter('reference_generator', 'amplitude') > 2.5:
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0


def fail(run):
    """Raise."""
    raise RuntimeError('no such thing')


def wait(run):
    """Tell which process this is and wait, while there is the mark ``wait``."""
    folder = Path(os.environ[MARKS])
    if (folder / 'wait').exists():
        (folder / str(os.getpid())).touch()
        time.sleep(300.0)
    return 1.0


def end(run):
    """End the process, as a script does."""
    sys.exit(3)


def interrupt(run):
    """Raise what Ctrl-C raises."""
    raise KeyboardInterrupt
