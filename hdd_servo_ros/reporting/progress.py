"""Progress display of a run, with its real-time factor."""

import collections
import contextlib
import sys
import time
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from tqdm import tqdm

_LINE_PERIOD = 5.0
_WINDOW = 5.0
"""Averaging time of the speed [s of wall time without pauses]."""


class Progress:
    """
    Progress on standard error: a bar on a terminal, otherwise a line every few seconds.

    The real-time factor and the remaining time refer to the last seconds in which the run was not paused.

    Parameters
    ----------
    title
        Name of the run.
    last_tick
        Last tick N.
    sample_time
        Sample time T [s].
    """

    def __init__(self, title: str, last_tick: int, sample_time: float) -> None:
        self._title = title
        self._sample_time = sample_time
        self._total = last_tick * sample_time
        self._window: collections.deque[tuple[float, float]] = collections.deque()
        self._seen: tuple[float, int] | None = None
        self._running = 0.0
        self._line_due = 0.0
        self._is_read = True
        self._bar = _bar(title, self._total) if sys.stderr.isatty() else None

    def show(self, tick: int) -> None:
        """Show that the run has reached ``tick``."""
        if not self._is_read:
            return
        try:
            self._show(tick)
        except OSError:
            # The reader of standard error is gone; the run continues.
            self._is_read = False

    def _show(self, tick: int) -> None:
        now = time.monotonic()
        if self._seen is None:
            self._seen, self._line_due = (now, tick), now + _LINE_PERIOD
            self._window.append((0.0, tick * self._sample_time))
        done = tick * self._sample_time
        speed = self._speed(now, tick)
        factor = f'real-time factor {speed:.3g}'
        left = (self._total - done) / speed if speed else 0.0
        if self._bar is not None:
            self._bar.set_postfix_str(f'{factor}, {left:.0f} s left', refresh=False)
            self._bar.update(done - self._bar.n)
        elif now >= self._line_due or tick * self._sample_time >= self._total:
            self._line_due = now + _LINE_PERIOD
            text = f'{self._title} {done:.2f} of {self._total:.2f} s, {factor}, {left:.0f} s left'
            print(text, file=sys.stderr, flush=True)

    def resume(self, tick: int) -> None:
        """Resume after a pause before ``tick``: the time since the last display does not count."""
        if self._seen is not None:  # not before the first display
            self._seen = (time.monotonic(), tick)

    def _speed(self, now: float, tick: int) -> float:
        """Return the real-time factor over the last seconds without pauses."""
        assert self._seen is not None
        then, last_tick = self._seen
        if tick > last_tick:
            self._running += now - then
            self._window.append((self._running, tick * self._sample_time))
            self._seen = (now, tick)
        while len(self._window) > 2 and self._window[-1][0] - self._window[1][0] >= _WINDOW:
            self._window.popleft()
        (first, first_time), (last, last_time) = self._window[0], self._window[-1]
        return (last_time - first_time) / max(last - first, 1e-9)

    def close(self) -> None:
        """End the line of the bar."""
        if self._bar is not None:
            with contextlib.suppress(OSError):
                self._bar.close()


def _bar(title: str, total: float) -> 'tqdm[NoReturn]':
    # Imported late: only a terminal has a bar.
    from tqdm import tqdm

    return tqdm(
        total=total,
        desc=title,
        mininterval=0.2,
        bar_format='{desc} {percentage:3.0f}% |{bar:30}| {n:.2f} of {total:.2f} s{postfix}',
    )
