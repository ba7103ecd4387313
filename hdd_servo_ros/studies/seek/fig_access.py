"""Access times: seek time over seek length for each method, and the bounds T* and LP."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.seek_bounds import fastest_seek, time_optimal_seek
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.studies.output import new_figure, save
from hdd_servo_ros.studies.seek.access_times import access_measures
from hdd_servo_ros.studies.seek.cases import BASE, PID
from hdd_servo_ros.studies.seek.drawing import STYLES

LENGTHS = (0.5, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 35.0, 50.0, 70.0, 100.0, 150.0, 250.0, 500.0, 1000.0)
"""Seek lengths [um]."""
SEEDS = 3
CASES = (*BASE.values(), PID)
_LONGEST_PROGRAM = 150.0
"""Maximum seek length for the drawn bound with modes [um]; in longer seeks the modes hardly add time."""
_TIMES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_MARKED = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the worst seek time of each method over seek length, with the lower bounds."""
    found = access_measures(runs, tuple(STYLES), LENGTHS, SEEDS)
    figure = new_figure('Seek time into ±100 nm, worst of 18 seeks, no computation delay', width=8.8, height=6.4)
    axes = figure.subplots()
    for method, style in STYLES.items():
        worst = np.array([found[method, length]['time'].max() for length in LENGTHS])
        axes.plot(LENGTHS, np.where(np.isfinite(worst), worst, np.nan), 'o-', markersize=4, linewidth=1.5, **style)
    plant = PlantParameters()
    lengths = np.geomspace(LENGTHS[0], LENGTHS[-1], 60)
    optimal = [1e3 * time_optimal_seek(plant, length).time for length in lengths.tolist()]
    axes.plot(lengths, optimal, color='black', linewidth=1.2, label='T*: rigid drive, bang-bang')
    axes.fill_between(lengths, 0.01, optimal, color='0.9', linewidth=0)
    short = [length for length in LENGTHS if length <= _LONGEST_PROGRAM]
    times = [1e3 * fastest_seek(plant, runs[CASES[0]].sample_time, length).time for length in short]
    axes.plot(short, times, color='black', linewidth=1.2, linestyle='--', label='LP: sampled drive with modes')
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_xticks(_MARKED, [f'{length:g}' for length in _MARKED])
    axes.set_yticks(_TIMES, [f'{time:g}' for time in _TIMES])
    axes.minorticks_off()
    axes.set_xlim(LENGTHS[0] / 1.1, LENGTHS[-1] * 1.1)
    axes.set_ylim(0.06, 60.0)
    axes.set_xlabel('seek length [µm]')
    axes.set_ylabel('seek time [ms]')
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=3, fontsize=9, frameon=False)
    return save(figure, path)
