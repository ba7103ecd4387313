"""The progress of a run, with its real-time factor, for a person."""

import sys
import time

from tqdm import tqdm

from hdd_servo_ros.ros.run import Run

_PERIOD = 0.2
_LINE_PERIOD = 5.0


class Progress:
    """
    A progress bar on a terminal, a line every few seconds elsewhere.

    Parameters
    ----------
    run
        The run; its simulated seconds are what is counted.
    """

    def __init__(self, run: Run) -> None:
        self._sample_time = run.sample_time
        self._started: float | None = None
        terminal = sys.stderr.isatty()
        self._bar = tqdm(
            total=run.last_tick * run.sample_time,
            unit='s',
            desc='run',
            mininterval=_PERIOD if terminal else _LINE_PERIOD,
            ascii=None if terminal else True,
            bar_format='{desc} {percentage:3.0f}% |{bar:30}| {n:.2f} of {total:.2f} s, {postfix}{remaining} left',
            leave=True,
        )

    def show(self, tick: int) -> None:
        """Show that the run has come to ``tick``."""
        now = time.monotonic()
        if self._started is None:
            self._started = now
        elapsed = max(now - self._started, 1e-9)
        done = tick * self._sample_time
        self._bar.set_postfix_str(f'real-time factor {done / elapsed:.2f}, ', refresh=False)
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Leave the bar as it is, and end its line."""
        self._bar.close()
