"""
What a worker process does with signals: it leaves them to its parent, and ends when this one asks for it or has ended.

Ctrl-C in a terminal, and its end, reach every process of a command; only the parent may decide what becomes of the
work. It asks a worker to end by :data:`ASKED_TO_END`: what is under way is interrupted, and nothing more is begun.
"""

import contextlib
import ctypes
import os
import signal
from collections.abc import Callable, Iterable
from types import FrameType
from typing import Any

ASKED_TO_END = signal.SIGUSR1
"""SIGTERM ends a worker at once: the executor sends it when another worker was killed, and may have left a lock."""
_PR_SET_PDEATHSIG = 1


class _State:
    """Of the worker that this process is: whether it works, and whether it is to begin no more."""

    is_working = False
    is_asked = False


def start(parent: int, pids: Any) -> None:
    """
    Become a worker; the first thing that the process does.

    Parameters
    ----------
    parent
        Process id of the parent.
    pids
        Queue that gets this process's own.
    """
    # Blocked and not ignored: a run that handles signals, as `simulate` does, must not receive it either.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(ASKED_TO_END, _end)
    _State.is_working = _State.is_asked = False
    # Whoever kills the parent leaves no worker behind that waits for ever.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)
    pids.put(os.getpid())


def work(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Do a piece of work in a worker; raises KeyboardInterrupt if it was asked to end."""
    _State.is_working = True
    try:
        if _State.is_asked:
            raise KeyboardInterrupt
        return function(*arguments, **options)
    finally:
        _State.is_working = False


def ask_to_end(pids: Any) -> list[int]:
    """Ask the workers whose process ids are in a queue to end; return their ids."""
    asked = []
    while not pids.empty():
        asked.append(pids.get())
    _send(asked, ASKED_TO_END)
    return asked


def kill(pids: Iterable[int]) -> None:
    """End workers at once."""
    _send(pids, signal.SIGKILL)


def _send(pids: Iterable[int], number: int) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def end_if_signaled(exit_code: int) -> None:
    """End the worker if a run that it has made was ended by a signal, by its exit code: it was meant for the worker."""
    if _State.is_asked:
        raise KeyboardInterrupt
    if exit_code > 128:
        signal.raise_signal(exit_code - 128)


def _end(number: int, frame: FrameType | None) -> None:
    _State.is_asked = True
    if not _State.is_working:
        return
    # A run that is under way closes its bag.
    of_the_run = signal.getsignal(signal.SIGTERM)
    if callable(of_the_run):
        of_the_run(signal.SIGTERM, frame)
    else:
        raise KeyboardInterrupt
