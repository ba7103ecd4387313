"""Seek, settle and follow: position, error, velocity and voltage of a 50 µm seek, as in fig. 1.4 of the thesis."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hdd_servo_ros.analysis.seek_metrics import FOLLOW, SEEK, SETTLE
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.output import new_figure, save
from hdd_servo_ros.studies.seek.cases import BASE, DWELL, TOLERANCE

CASES = (BASE['final_state'],)
SHADES = {FOLLOW: ('#e3f1e3', 'follow'), SEEK: ('#dde8f7', 'seek'), SETTLE: ('#fdeeca', 'settle')}
"""Color and name of each mode."""
_FROM, _TO = -0.3, 2.4
"""Drawn interval, relative to the target change [ms]."""


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw four panels over a common time axis, shaded by mode."""
    run = runs[CASES[0]]
    time = 1e3 * (run.time - DWELL)
    rows = (time >= _FROM - 0.05) & (time <= _TO + 0.05)
    time = time[rows]
    figure = new_figure('A seek of 50 µm by final-state control: seek, settle, follow', width=8.5, height=7.4)
    wide, fine, speed, voltage = figure.subplots(4, 1, sharex=True, height_ratios=(1.25, 1.25, 0.9, 0.9))
    mode = np.rint(run.estimates['seek_mode'][rows]).astype(int)
    for axes in (wide, fine, speed, voltage):
        shade(axes, time, mode, named=axes is wide)
    wide.step(time, run.desired_position[rows], where='post', color='0.35', linestyle='--', label='target')
    wide.plot(time, run.position[rows], color='C0', linewidth=1.8, label='head')
    wide.plot(time, run.estimates['seek_trajectory'][rows], 'o', color='C1', markersize=2.6, label='trajectory')
    wide.set_ylabel('position [µm]')
    wide.set_ylim(-4.0, 62.0)
    wide.legend(loc='lower right', fontsize=9, framealpha=0.9)
    fine.axhspan(-1e3 * TOLERANCE, 1e3 * TOLERANCE, color='white', alpha=0.75, zorder=0.5)
    for edge in (-TOLERANCE, TOLERANCE):
        fine.axhline(1e3 * edge, color='0.5', linewidth=0.7, linestyle=':')
    error = 1e3 * (run.position - run.desired_position)[rows]
    for part in (time < -1e-6, time > -1e-6):
        # Between the two parts the target changes, not the head position.
        fine.plot(time[part], error[part], '.-', color='C0', linewidth=1.3, markersize=4.0)
    fine.set_ylim(-210.0, 210.0)
    fine.set_ylabel('head - target [nm]')
    fine.text(_TO, 1e3 * TOLERANCE + 12.0, '±100 nm ', ha='right', va='bottom', fontsize=8, color='0.35')
    speed.plot(time, 1e-3 * run.head.velocity[rows], color='C2', linewidth=1.5)
    speed.set_ylabel('velocity [mm/s]')
    voltage.step(time, run.command[rows], where='post', color='C3', linewidth=1.3)
    voltage.set_ylabel('u [V]')
    voltage.set_ylim(-11.0, 11.0)
    voltage.set_xlabel('time after the target change [ms]')
    voltage.set_xlim(_FROM, _TO)
    figure.align_ylabels()
    return save(figure, path)


def shade(axes: Axes, time: NDArray[np.float64], mode: NDArray[np.int_], named: bool = False) -> None:
    """Shade the background of axes by mode, and optionally label the modes."""
    starts = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist()]
    for start, end in zip(starts, [*starts[1:], len(time) - 1], strict=True):
        color, name = SHADES[int(mode[start])]
        axes.axvspan(time[start], time[end], color=color, linewidth=0, zorder=0)
        if named:
            middle = 0.5 * (max(time[start], _FROM) + min(time[end], _TO))
            axes.text(middle, 0.97, name, ha='center', va='top', fontsize=10, transform=axes.get_xaxis_transform())
