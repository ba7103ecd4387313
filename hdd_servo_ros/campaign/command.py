"""Exit codes and interruption of the commands that make many runs."""

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from hdd_servo_ros.messages.exit_codes import guard

KEPT = 'finished runs are kept, and the next call resumes there'


def exit_code(name: str, work: Callable[[], int], *, kept: str = KEPT) -> int:
    """
    Run a command, and return its exit code.

    Parameters
    ----------
    name
        Name of the command, for messages.
    work
        Returns 0 if complete, 1 if partial.
    kept
        Message about the completed work after an interruption.

    Returns
    -------
    int
        Result of ``work``; 1 if a run failed, 2 for invalid arguments or parameters, 128 + n after signal n.
    """
    if threading.current_thread() is threading.main_thread():  # Python allows no handlers elsewhere.
        for number in (signal.SIGTERM, signal.SIGHUP):
            # `nohup` ignores SIGHUP, so that the work continues.
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, _end)
    return guard(name, lambda: _done(name, work, kept))


def _done(name: str, work: Callable[[], int], kept: str) -> int:
    try:
        return work()
    except KeyboardInterrupt:
        print(f'{name}: interrupted; {kept}', file=sys.stderr)
        return 128 + signal.SIGINT
    except _Ended as ended:
        print(f'{name}: ended by {signal.Signals(ended.number).name}; {kept}', file=sys.stderr)
        return 128 + ended.number


class _Ended(SystemExit):
    """A signal requests the end."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = number


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise _Ended(number)
