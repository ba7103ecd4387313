"""Detection of faults in the output and exit code of a process, and in the run that it recorded."""

import contextlib
import io
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import yaml

from faults.campaign import HANG, NOT_FINITE, TRACEBACK, WRONG, Fault
from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import BagError

LONGEST_CALL = 20.0
"""Limit of the processor time of a call in this process, which usually takes a few hundredths of it [s]."""
LONGEST_WAIT = 60.0
"""Limit of its wall time, as a multiple; a call that sleeps forever uses no processor time."""


class _TooLong(BaseException):
    """A call that does not return; a BaseException, so that no `except Exception` catches it."""


def call(function: Callable[..., Any], *arguments: Any) -> tuple[Any, str, list[Fault]]:
    """
    Call the main function of a command.

    Returns
    -------
    tuple
        Exit code, None after an exception; output; faults.
    """

    def end(number: int, frame: FrameType | None) -> None:
        raise _TooLong

    printed = io.StringIO()
    # Wall time alone would report a hang on a busy machine.
    timers = {signal.ITIMER_PROF: signal.SIGPROF, signal.ITIMER_REAL: signal.SIGALRM}
    previous = {number: signal.signal(number, end) for number in timers.values()}
    signal.setitimer(signal.ITIMER_PROF, LONGEST_CALL)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_CALL * LONGEST_WAIT)
    code, faults = None, []
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            code = function(*arguments)
    except SystemExit as ended:
        code = ended.code
    except _TooLong:
        limit = f'{LONGEST_CALL:g} s of processor time or {LONGEST_WAIT:g} times that'
        faults.append(Fault(HANG, f'{function.__module__} did not return in {limit}'))
    except BaseException as error:
        faults.append(Fault(TRACEBACK, f'{function.__module__}: {type(error).__name__}: {str(error)[:200]}'))
    finally:
        for timer, number in timers.items():
            signal.setitimer(timer, 0.0)
            signal.signal(number, previous[number])
    faults += tracebacks(printed.getvalue(), function.__module__)
    return code, printed.getvalue(), faults


def tracebacks(output: str, name: str) -> list[Fault]:
    """Return a fault if the output contains a traceback."""
    if 'Traceback (most recent call last)' not in output:
        return []
    return [Fault(TRACEBACK, f'{name}: {output.strip().splitlines()[-1][:200]}')]


def status_of(folder: Path) -> str:
    """Return the status in `run.yaml`, ``none`` without the file."""
    path = folder / 'run.yaml'
    return str(yaml.safe_load(path.read_text())['status']) if path.exists() else 'none'


def false_claims(folder: Path, code: int | None, reference: Run | None) -> Iterator[Fault]:
    """
    Yield the claims of a run that its files do not confirm.

    Parameters
    ----------
    folder
        Directory of the run.
    code
        Exit code of the process; None if it was killed.
    reference
        An undisturbed run with the same parameters, of which the run must be a part; None if it may differ.
    """
    content = yaml.safe_load((folder / 'run.yaml').read_text())
    status = content['status']
    if (status == 'finished') != (code == 0) and code is not None:
        yield Fault(WRONG, f'status {status} with exit code {code}')
    if status in ('failed', 'interrupted') and not content['reason']:
        yield Fault(WRONG, f'status {status} without a reason')
    if status == 'running':
        return
    if content['last_tick'] is None or content['last_tick'] < 0:
        if status == 'finished':
            yield Fault(WRONG, 'finished without a tick')
        return
    try:
        run = Run.open(folder)
    except (BagError, FileNotFoundError) as error:
        yield Fault(WRONG, str(error))
        return
    if len(run.time) != content['last_tick'] + 1:
        yield Fault(WRONG, f'last tick {content["last_tick"]} with {len(run.time)} ticks')
    if status == 'finished' and len(run.time) != content['last_tick_planned'] + 1:
        yield Fault(WRONG, f'finished with {len(run.time)} ticks')
    for topic in ('reference', 'head', 'ldv', 'control', 'estimates'):
        values = np.asarray(run[topic])
        if status == 'finished' and not np.isfinite(values).all():
            yield Fault(NOT_FINITE, f'/{topic}')
        if reference is not None and values.tobytes() != np.asarray(reference[topic])[: len(values)].tobytes():
            yield Fault(WRONG, f'/{topic} differs from the undisturbed run')


def wait_until(condition: Callable[[], object], seconds: float) -> bool:
    """Wait for a condition; return whether it became true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def first_line(texts: Sequence[str], word: str) -> str:
    """Return the first line that contains a word."""
    return next((line for text in texts for line in text.splitlines() if word in line), '')
