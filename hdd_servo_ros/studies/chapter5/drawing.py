"""Layouts shared by several figures of chapter 5."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

ESTIMATES = {
    'sigma_hat': (r'$\hat\sigma$ [µV s/µm]', 1e6, 'C0'),
    'm_hat': (r'$\hat m$ [nV s²/µm]', 1e9, 'C1'),
    'phi_hat': (r'$\hat\varphi$ [mV]', 1e3, 'C2'),
    'W_norm': (r'$\|\hat W\|$ [mV]', 1e3, 'C3'),
}
"""Axis label, scale factor and color of the signals in figs. 5.11, 5.12, 5.17 and 5.18."""
Quantity = Callable[[RecordedRun], NDArray[np.float64]]


def draw_start_and_end(
    runs: RecordedRuns,
    path: Path,
    title: str,
    label: str,
    cases: Mapping[str, Case],
    quantity: Quantity,
    end: float,
    start: float = 0.5,
) -> Path:
    """
    Draw a quantity of several runs at their start and at their end.

    Parameters
    ----------
    runs, path
        See :meth:`~hdd_servo_ros.studies.chapter.Figure.make`.
    title, label
        Title of the figure, and axis label of the quantity.
    cases
        Runs by their name in the legend.
    quantity
        Function that returns the quantity of a run.
    end, start
        Durations to draw at the end and at the start [s].
    """
    figure = new_figure(title)
    start_axes, end_axes = figure.subplots(2, 1)
    for index, (name, case) in enumerate(cases.items()):
        run = runs[case]
        values = quantity(run)
        style = {'color': f'C{index}', 'label': name, 'linewidth': 0.9}
        early = run.time <= start
        draw(start_axes, run.time[early], values[early], **style)
        late = run.time >= run.time[-1] - end
        draw(end_axes, run.time[late], values[late], **style)
    for axes in (start_axes, end_axes):
        axes.set_ylabel(label)
    end_axes.set_xlabel('time [s]')
    legend_above(start_axes)
    return save(figure, path)


def draw_estimates(runs: RecordedRuns, path: Path, title: str, case: Case) -> Path:
    """Draw the four estimates over an entire run."""
    figure = new_figure(title, height=6.5)
    run = runs[case]
    every = figure.subplots(len(ESTIMATES), 1, sharex=True)
    for axes, (name, (label, factor, color)) in zip(every, ESTIMATES.items(), strict=True):
        draw(axes, run.time, factor * run.estimates[name], color=color)
        axes.set_ylabel(label)
    every[-1].set_xlabel('time [s]')
    return save(figure, path)
