"""Signals that ask a run to end."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupts:
    """
    The first signal that asked the run to end, to be looked at between two pieces of it.

    Attributes
    ----------
    number
        The signal's number, 0 if there was none.
    """

    def __init__(self) -> None:
        self.number = 0

    def take(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if self.number:
            # Asked twice: a step that never returns keeps the first from being looked at.
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        self.number = number


@contextlib.contextmanager
def interrupts() -> Iterator[Interrupts]:
    """
    Collect signals instead of being ended by them.

    Off the main thread Python allows no handlers: signals then go to whoever has the main thread.
    """
    collected = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield collected
        return
    previous = {number: signal.signal(number, collected.take) for number in _SIGNALS}
    try:
        yield collected
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
