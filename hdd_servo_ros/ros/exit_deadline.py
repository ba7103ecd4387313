"""
Deadline for the shutdown of DDS: a process whose run has ended must end too, with the right exit code.

A node process was once observed to hang for 300 s after a peer had been killed and its own run had failed. Its stack is
not known, but Fast DDS 2.14 can deadlock when it destroys an endpoint (eProsima/Fast-DDS issues 4026, 6193 and 6502):
the destructor of a timed event waits until the event thread is idle, while the event thread waits for a mutex. This
package cannot prevent that. Such a call may hold the GIL, so that neither a Python thread nor a signal handler in
Python can run. Therefore the deadline is a POSIX timer that calls ``_exit`` of the C library.
"""

import contextlib
import ctypes
import faulthandler
import functools
import sys
from collections.abc import Iterator

SHUTDOWN_TIMEOUT = 30.0
"""Longest time for a shutdown of DDS, which takes a fraction of a second unless the machine is very busy [s]."""
_REPORT_BEFORE = 1.0
"""The stack of a process is printed this long before it is ended [s]."""
_STDERR = 2
_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _Sigevent(ctypes.Structure):
    """``struct sigevent`` of Linux, which is padded to 64 bytes."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signo', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


class _Itimerspec(ctypes.Structure):
    """``struct itimerspec``; the interval stays zero, so that the timer expires once."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('interval_s', 'interval_ns', 'seconds', 'nanoseconds'))


@functools.cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def start_deadline(seconds: float, exit_code: int) -> ctypes.c_void_p | None:
    """
    End this process after a time, whatever it waits for, unless :func:`cancel_deadline` is called before.

    Parameters
    ----------
    seconds
        The time [s]. Shortly before it expires, the Python stack is printed on stderr.
    exit_code
        Exit code of the process.

    Returns
    -------
    ctypes.c_void_p or None
        The timer; None if the operating system provides none.
    """
    if sys.platform != 'linux':
        return None
    event = _Sigevent(value=exit_code, notify=_SIGEV_THREAD, function=ctypes.cast(_libc()._exit, ctypes.c_void_p).value)
    timer = ctypes.c_void_p()
    if _libc().timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        return None
    with contextlib.suppress(OSError, ValueError):  # stderr may be closed
        faulthandler.dump_traceback_later(max(seconds - _REPORT_BEFORE, seconds / 2), file=_STDERR)
    full_seconds = int(seconds)
    expiry = _Itimerspec(seconds=full_seconds, nanoseconds=int((seconds - full_seconds) * 1e9))
    _libc().timer_settime(timer, 0, ctypes.byref(expiry), None)
    return timer


def cancel_deadline(timer: ctypes.c_void_p | None) -> None:
    """Cancel a deadline."""
    if timer is not None:
        faulthandler.cancel_dump_traceback_later()
        _libc().timer_delete(timer)


@contextlib.contextmanager
def exit_deadline(exit_code: int, seconds: float = SHUTDOWN_TIMEOUT) -> Iterator[None]:
    """End this process with an exit code if the body of the ``with`` statement takes longer than a time [s]."""
    timer = start_deadline(seconds, exit_code)
    try:
        yield
    finally:
        cancel_deadline(timer)
