"""Operating system signals that request the end of a run."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupts:
    """
    First signal that requested the end of the run; the run checks it between two pieces.

    Attributes
    ----------
    number
        Number of the signal; 0 without a signal.
    """

    def __init__(self) -> None:
        self.number = 0

    def take(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if self.number:
            # A second request ends the process at once, because a step that never returns blocks the first request.
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        self.number = number


@contextlib.contextmanager
def interrupts() -> Iterator[Interrupts]:
    """
    Collect signals instead of terminating the process.

    Python allows signal handlers in the main thread only. In another thread, this context manager collects nothing, and
    signals go to the handlers of the main thread.
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
