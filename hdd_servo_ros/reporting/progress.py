"""The progress of a run, with its real-time factor, for a person."""

import collections
import contextlib
import sys
import time
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from tqdm import tqdm

_LINE_PERIOD = 5.0
_WINDOW = 5.0
"""Over how long the speed is taken [s of wall time without pauses]."""


class Progress:
    """
    A progress bar on a terminal, a line every few seconds elsewhere, on standard error.

    The real-time factor, and the time that is left, are those of the last seconds in which the run was not paused.

    Parameters
    ----------
    title
        What is running.
    last_tick
        N.
    sample_time
        T [s].
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
        """Show that the run has come to ``tick``, as long as there is somebody to show it to."""
        if not self._is_read:
            return
        try:
            self._show(tick)
        except OSError:
            # Whoever read standard error is gone; the run goes on without.
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

    def go_on(self, tick: int) -> None:
        """Go on after a pause before ``tick``: the time since the last one that was shown does not count."""
        if self._seen is not None:  # nothing counts before the first one
            self._seen = (time.monotonic(), tick)

    def _speed(self, now: float, tick: int) -> float:
        """Return the seconds of the run per second of wall time, over the last seconds without pauses."""
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
        """Leave the bar as it is, and end its line."""
        if self._bar is not None:
            with contextlib.suppress(OSError):
                self._bar.close()


def _bar(title: str, total: float) -> 'tqdm[NoReturn]':
    # Late: only a terminal has a bar.
    from tqdm import tqdm

    return tqdm(
        total=total,
        desc=title,
        mininterval=0.2,
        bar_format='{desc} {percentage:3.0f}% |{bar:30}| {n:.2f} of {total:.2f} s{postfix}',
    )
