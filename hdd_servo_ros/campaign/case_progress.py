"""Progress of the runs of a study: a bar on a terminal, otherwise one line per run."""

import re
import sys
import time
from collections.abc import Callable, Iterable

from tqdm import tqdm

from hdd_servo_ros.campaign.case import PlannedRun

_PROGRESS = re.compile(r'(\d+\.\d+) of (\d+\.\d+) s')


class CaseProgress:
    """
    Progress of runs, measured in ticks.

    Parameters
    ----------
    due
        All runs.
    report
        Called with each progress line.
    """

    def __init__(self, due: Iterable[PlannedRun], report: Callable[[str], None]) -> None:
        self._report = report
        self._left = list(due)
        self._count = len(self._left)
        self._ticks_due = sum(run.ticks for run in self._left)
        self._ticks_done = 0
        self._started = time.monotonic()
        self._bar = tqdm(
            total=self._ticks_due,
            disable=not sys.stderr.isatty(),
            bar_format='{percentage:3.0f}% |{bar:30}| {postfix}, {remaining} left',
        )

    def finished(self, run: PlannedRun) -> None:
        """Count a run as made."""
        self._left.remove(run)
        self._ticks_done += run.ticks
        if self._bar.disable:
            self._report(f'{self._count - len(self._left)} of {self._count} runs: {run.case.name}, {self._time_left()}')

    def show(self) -> None:
        """Show the bar, if there is a terminal."""
        if not self._bar.disable:
            names = ', '.join(run.case.name for run in self._left if run.log.exists())
            text = f'{self._count - len(self._left)} of {self._count} runs, now {names}'
            self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(self._ticks() - self._bar.n)

    def close(self) -> None:
        """End the line of the bar."""
        self._bar.close()

    def _ticks(self) -> float:
        """Return the number of completed ticks; those of running runs are read from their logs."""
        total = float(self._ticks_done)
        for run in self._left:
            try:
                progress = _PROGRESS.findall(run.log.read_text(errors='replace'))
            except FileNotFoundError:
                continue
            if progress:
                total += run.ticks * float(progress[-1][0]) / float(progress[-1][1])
        return total

    def _time_left(self) -> str:
        done = self._ticks()
        left = (time.monotonic() - self._started) * (self._ticks_due / done - 1.0)
        return f'about {left / 60.0:.0f} min left' if left > 90.0 else f'about {left:.0f} s left'
