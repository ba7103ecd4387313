"""Shocks of 63 g and 300 g: acceleration of the base, and head error with and without feedforward."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, SHOCK
from hdd_servo_ros.studies.mobile.drawing import STYLES, error
from hdd_servo_ros.studies.mobile.shock_measures import BEFORE, LIMIT, peak_and_time
from hdd_servo_ros.studies.output import draw, new_figure, save

G = 9.80665
"""Standard gravity [m/s^2]."""
_SHOWN = (-2.0, 12.0)
"""Drawn interval relative to the start of the shock [ms]."""
CASES = tuple(case for by_controller in SHOCK.values() for cases in by_controller.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw one column per shock: base acceleration above, errors of each controller below."""
    figure = new_figure('Half-sine shocks of 2 ms, imbalance 2 %', width=10.0, height=7.0)
    every = figure.subplots(3, 2, sharex=True)
    for column, (level, by_controller) in enumerate(SHOCK.items()):
        top, *others = every[:, column]
        top.set_title(f'{level:g} g', fontsize=10)
        draw_base(runs, top, by_controller['pid']['none'])
        for axes, (controller, name) in zip(others, CONTROLLERS.items(), strict=True):
            for case in by_controller[controller].values():
                draw_error(runs, axes, case)
            axes.set_ylabel(f'{name}: error [nm]')
            legend(axes)
        others[-1].set_xlabel('time after the start of the shock [ms]')
    figure.align_ylabels()
    return save(figure, path)


def legend(axes: Axes) -> None:
    """Add the legend to axes with errors, where the curves leave room for it."""
    title = f'peak, time beyond {LIMIT:g} nm'
    axes.legend(title=title, fontsize=8, title_fontsize=8, frameon=False, loc='lower right')


def draw_base(runs: RecordedRuns, axes: Axes, case: Case) -> None:
    """Draw the linear base acceleration during a shock [g]."""
    run = runs[case]
    time = _since_shock(runs, case)
    rows = (time >= _SHOWN[0]) & (time <= _SHOWN[1])
    draw(axes, time[rows], run['base_acceleration'][rows, 1] / G, color='C7', drawstyle='steps-post')
    axes.set_ylabel('base [g]')


def draw_error(runs: RecordedRuns, axes: Axes, case: Case) -> None:
    """Draw the error during a shock, with peak and time beyond ``LIMIT`` in the legend."""
    run = runs[case]
    time = _since_shock(runs, case)
    peak, outside = peak_and_time(error(run)[time >= -1e3 * BEFORE], run.sample_time)
    rows = (time >= _SHOWN[0]) & (time <= _SHOWN[1])
    method = runs.parameters(case)[f'{case.controller}_controller']['feedforward.method']
    style = STYLES[method]
    label = f'{style["label"]}: {peak:.0f} nm, {outside:.1f} ms'
    draw(axes, time[rows], error(run)[rows], **{**style, 'label': label, 'linewidth': 1.3})
    axes.axhspan(-LIMIT, LIMIT, color='0.93', zorder=0)


def _since_shock(runs: RecordedRuns, case: Case) -> NDArray[np.float64]:
    """Return the time since the start of the shock [ms]."""
    start = float(runs.parameters(case)['disturbance_generator']['shock.time'])
    return np.asarray(1e3 * (runs[case].time - start))
