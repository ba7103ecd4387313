"""Figs. 5.13 to 5.16: response and control on the steps."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import LAW_STEPS, PID_FOR_SINES_STEPS, PID_STEPS, SHIPPED_STEPS
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

_EDGE = 5.0
"""Time of the drawn rising edge [s]."""
_BEFORE = 0.002
_AFTER = 0.015
"""Durations drawn before and after the edge [s]."""


def compared(height: float) -> dict[str, Case]:
    """Return the runs of one height [um] by their name in the legend."""
    return {
        'PID': PID_STEPS[height],
        'law of the thesis': LAW_STEPS[height],
        'adaptive NN as shipped': SHIPPED_STEPS[height],
        'PID for sines': PID_FOR_SINES_STEPS[height],
    }


def draw_response(runs: RecordedRuns, path: Path, number: str, height: float) -> Path:
    """Draw a figure with the step responses and their errors."""
    figure = new_figure(f'Fig. {number}: response to a step of {height:g} µm', height=5.5)
    position, error = figure.subplots(2, 1, sharex=True)
    for index, (name, case) in enumerate(compared(height).items()):
        run = runs[case]
        milliseconds, shown = edge_window(run.time)
        x_d, x = run.desired_position[shown], run.position[shown]
        if index == 0:
            draw(position, milliseconds, x_d, color='0.2', linestyle=':', label='reference')
        draw(position, milliseconds, x, color=f'C{index}', label=name)
        draw(error, milliseconds, 100.0 * (x - x_d) / height, color=f'C{index}')
    error.axhspan(-2.0, 2.0, color='0.85', zorder=0)
    # The PID for sines exceeds these limits; the position panel shows by how much.
    error.set_ylim(-20.0, 35.0)
    position.set_ylabel('position [µm]')
    error.set_ylabel('error [% of the step]')
    error.set_xlabel('time after the edge [ms]; gray: 2 % band')
    legend_above(position)
    return save(figure, path)


def draw_control(runs: RecordedRuns, path: Path, number: str, height: float) -> Path:
    """Draw a figure with the commands in full range, and without the PID peaks."""
    figure = new_figure(f'Fig. {number}: control, step of {height:g} µm', height=5.5)
    whole, close = figure.subplots(2, 1, sharex=True)
    largest = 0.0
    for index, (name, case) in enumerate(compared(height).items()):
        run = runs[case]
        milliseconds, shown = edge_window(run.time)
        u = run.command[shown]
        for axes in (whole, close):
            draw(axes, milliseconds, u, color=f'C{index}', label=name)
        if not name.startswith('PID'):
            largest = max(largest, float(np.abs(u).max()))
    close.set_ylim(-largest, largest)
    for axes in (whole, close):
        axes.set_ylabel('u [V]')
    close.set_xlabel('time after the edge [ms]')
    legend_above(whole)
    return save(figure, path)


def edge_window(time: NDArray[np.float64]) -> tuple[NDArray[np.float64], slice]:
    """Return the time since the drawn edge [ms], and the drawn rows."""
    first, last = np.searchsorted(time, (_EDGE - _BEFORE, _EDGE + _AFTER))
    shown = slice(int(first), int(last))
    return 1e3 * (time[shown] - _EDGE), shown
