"""Contribution of each disturbance source to the track error, from runs without the source."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.sources import CASES_BY_NAME, SEEDS, contributions
from hdd_servo_ros.studies.output import new_figure, save

CASES = tuple(CASES_BY_NAME.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw bars for the total and the contributions, one panel per run."""
    figure = new_figure('PID: track error by source, 3 sigma', width=10.0, height=6.5)
    panels = np.ravel(figure.subplots(-(-len(CASES_BY_NAME) // 2), 2))
    for axes, (name, found) in zip(panels, contributions(runs, SEEDS).items(), strict=False):
        bars = {'all': found.total, **found.by_source}
        colors = ['0.6' if source in ('all', 'rest') else 'C0' for source in bars]
        axes.barh(range(len(bars)), list(bars.values()), color=colors)
        axes.set_yticks(range(len(bars)), list(bars), fontsize=8)
        axes.invert_yaxis()
        axes.axvline(0.0, color='0.3', linewidth=0.8)
        axes.set_xlabel('3 sigma [nm]', fontsize=8)
        axes.set_title(name, fontsize=10)
    return save(figure, path)
