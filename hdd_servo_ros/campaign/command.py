"""What the commands that make many runs have in common: how they end."""

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from hdd_servo_ros.messages.exit_codes import guard

KEPT = 'finished runs are kept, and the next call goes on from there'


def exit_code(name: str, work: Callable[[], int], *, kept: str = KEPT) -> int:
    """
    Do a command's work, and return its exit code.

    Parameters
    ----------
    name
        What the command is called, for messages.
    work
        Returns 0 for done, 1 for done in part.
    kept
        What an interrupted user is told of the work so far.

    Returns
    -------
    int
        As ``work`` says; 1 if a run failed, 2 for wrong arguments or parameters, 128 + n if ended by signal n.
    """
    if threading.current_thread() is threading.main_thread():  # Python allows no handlers elsewhere.
        for number in (signal.SIGTERM, signal.SIGHUP):
            # As `nohup` has it, which asks for the work to go on.
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
    """A signal asks for the end."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.number = number


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise _Ended(number)
