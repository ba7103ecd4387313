"""
A run in one picture: reference and head, error, control, estimates; the whole run and its last moments.

That of a run whose head follows nothing shows neither reference nor error.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.reporting.summary import NOT_ADAPTED, OPEN_LOOP

_CLOSE_UP = 0.03
_POINTS = 4000
_BANDS = 1000
_ESTIMATES = 6


def plot_run(signals: Signals, run: dict[str, Any], path: Path) -> None:
    """
    Draw a run into a PNG file.

    Parameters
    ----------
    signals
        From :func:`read_signals`.
    run
        Content of ``run.yaml``.
    path
        File to write.
    """
    length, volt = run.get('length_unit', 'um'), run.get('control_unit', 'V')
    shown_length = length.replace('um', 'µm')
    error_unit, factor = ('nm', 1e3) if length == 'um' else (shown_length, 1.0)
    # Not pyplot: a picture into a file needs no display, and no choice of one for the whole process.
    layout = ConstrainedLayoutEngine(rect=(0.0, 0.03, 1.0, 0.97))  # the legend of the estimates stands below
    figure = Figure(figsize=(13, 10.5), layout=layout)
    FigureCanvasAgg(figure)
    tracks = run['controller'] not in OPEN_LOOP
    axes = figure.subplots(4 if tracks else 3, 2, sharex='col', width_ratios=(2, 1))
    end = signals.time[-1]
    rows = len(signals.time)
    close_up = slice(int(np.searchsorted(signals.time, end - _CLOSE_UP)), rows)
    for column, (window, title) in enumerate(((slice(0, rows), 'whole run'), (close_up, 'last moments'))):
        time = signals.time[window]
        top, *error, control, estimates = axes[:, column]
        top.set_title(title, fontsize=10)
        if tracks:
            _line(top, time, signals.reference[window, 0], color='0.3', linewidth=2.5, alpha=0.5, label='reference')
            _line(error[0], time, factor * (signals.head[window, 0] - signals.reference[window, 0]), color='C3')
        _line(top, time, signals.head[window, 0], color='C0', label='head')
        _line(control, time, signals.control[window, 0], color='C2', label='total')
        _line(control, time, signals.control[window, 2], color='C1', linewidth=0.8, label='feedback part')
        _draw_estimates(estimates, signals, window)
        estimates.set_xlabel('time [s]')
        for axis in axes[:, column]:
            axis.grid(alpha=0.3)
            axis.margins(x=0.01)
    axes[0, 0].set_ylabel(f'position [{shown_length}]')
    if tracks:
        axes[1, 0].set_ylabel(f'error [{error_unit}]')
    axes[-2, 0].set_ylabel(f'control [{volt}]')
    axes[-1, 0].set_ylabel('estimates, each over\nits largest magnitude')
    for row in (0, -2):
        axes[row, 1].legend(loc='upper right', fontsize=8)
    handles, labels = axes[-1, 1].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc='lower center', fontsize=8, ncols=6, frameon=False)
    figure.suptitle(f'{run["controller"]} on {run["frame_id"]}, T = {run["sample_time"] * 1e3:g} ms')
    figure.savefig(path, dpi=110)


def _draw_estimates(axis: Axes, signals: Signals, window: slice) -> None:
    drawn = 0
    for name, column in signals.estimates.items():
        largest = np.abs(column).max()
        if name in NOT_ADAPTED or not np.any(column != column[0]) or drawn == _ESTIMATES:
            continue
        _line(
            axis, signals.time[window], column[window] / largest, color=f'C{drawn}', label=f'{name} (max {largest:.3g})'
        )
        drawn += 1


def _line(axis: Axes, time: Any, values: Any, **style: Any) -> None:
    """Draw a signal; a long one as the band between its extremes, which keeps every peak that a person could see."""
    if len(time) <= _POINTS:
        axis.plot(time, values, **{'linewidth': 1.1, **style})
        return
    block = -(-len(time) // _BANDS)
    starts = np.arange(0, len(time), block)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    style.pop('linestyle', None)
    axis.fill_between(time[starts], low, high, **{'alpha': 0.55, **style, 'linewidth': 0.8})
