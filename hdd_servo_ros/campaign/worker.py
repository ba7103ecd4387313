"""
Signals in a worker process: it leaves them to its parent, and ends with it or on request.

Ctrl-C in a terminal, and closing the terminal, signal every process of a command, but only the parent decides how to
end. It sends :data:`END_REQUEST` to a worker, which interrupts its work and starts nothing more.
"""

import contextlib
import ctypes
import os
import signal
from collections.abc import Callable, Iterable
from types import FrameType
from typing import Any

END_REQUEST = signal.SIGUSR1
"""SIGTERM ends a worker at once: the executor sends it when another worker was killed, perhaps holding a lock."""
_PR_SET_PDEATHSIG = 1


class _State:
    """State of this worker process: whether it is working, and whether its end was requested."""

    is_working = False
    is_end_requested = False


def start(parent: int, pids: Any) -> None:
    """
    Become a worker; called first in the process.

    Parameters
    ----------
    parent
        Process id of the parent.
    pids
        Queue for the process ids of the workers.
    """
    # Blocked, not ignored: a run that installs signal handlers, such as `simulate`, must not receive them either.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(END_REQUEST, _end)
    _State.is_working = _State.is_end_requested = False
    # If the parent is killed, its workers end instead of waiting forever.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)
    pids.put(os.getpid())


def work(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Call a function in a worker; raises KeyboardInterrupt if the end was requested."""
    _State.is_working = True
    try:
        if _State.is_end_requested:
            raise KeyboardInterrupt
        return function(*arguments, **options)
    finally:
        _State.is_working = False


def ask_to_end(pids: Any) -> list[int]:
    """Request the end of the workers whose process ids are in a queue; return the ids."""
    asked = []
    while not pids.empty():
        asked.append(pids.get())
    _send(asked, END_REQUEST)
    return asked


def kill(pids: Iterable[int]) -> None:
    """End workers at once."""
    _send(pids, signal.SIGKILL)


def _send(pids: Iterable[int], number: int) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def end_if_signaled(exit_code: int) -> None:
    """End the worker if the exit code shows that a signal ended its run: the signal was meant for the worker."""
    if _State.is_end_requested:
        raise KeyboardInterrupt
    if exit_code > 128:
        signal.raise_signal(exit_code - 128)


def _end(number: int, frame: FrameType | None) -> None:
    _State.is_end_requested = True
    if not _State.is_working:
        return
    # The current run closes its bag.
    of_the_run = signal.getsignal(signal.SIGTERM)
    if callable(of_the_run):
        of_the_run(signal.SIGTERM, frame)
    else:
        raise KeyboardInterrupt
