"""The progress of a run, with its real-time factor, for a person."""

import contextlib
import sys
import time

from tqdm import tqdm

_LINE_PERIOD = 5.0


class Progress:
    """
    A progress bar on a terminal, a line every few seconds elsewhere, on standard error.

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
        self._started: float | None = None
        self._line_due = 0.0
        self._is_read = True
        self._bar = tqdm(
            total=self._total,
            disable=not sys.stderr.isatty(),
            desc=title,
            mininterval=0.2,
            bar_format='{desc} {percentage:3.0f}% |{bar:30}| {n:.2f} of {total:.2f} s, {postfix}{remaining} left',
        )

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
        if self._started is None:
            self._started, self._line_due = now, now + _LINE_PERIOD
        done = tick * self._sample_time
        factor = f'real-time factor {done / max(now - self._started, 1e-9):.3g}'
        if not self._bar.disable:
            self._bar.set_postfix_str(f'{factor}, ', refresh=False)
            self._bar.update(done - self._bar.n)
        elif now >= self._line_due or tick * self._sample_time >= self._total:
            self._line_due = now + _LINE_PERIOD
            left = (now - self._started) * (self._total / done - 1.0) if done else 0.0
            text = f'{self._title} {done:.2f} of {self._total:.2f} s, {factor}, {left:.0f} s left'
            print(text, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the bar as it is, and end its line."""
        with contextlib.suppress(OSError):
            self._bar.close()
