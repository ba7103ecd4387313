"""Effect of friction on arrival: error after a seek without feedforward, with it, and after learning."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.output import new_figure, save
from hdd_servo_ros.studies.seek.cases import (
    DWELL,
    FRICTIONS,
    LEARNED,
    LEARNED_AFTER,
    LEARNING_LENGTHS,
    NO_FRICTION,
    UNLEARNED,
)
from hdd_servo_ros.studies.seek.drawing import FRICTION_STYLES, narrow_band

CASES = (*NO_FRICTION.values(), *UNLEARNED.values(), *LEARNED.values())
_SHOWN = 20.0
"""Time drawn after the target change [ms]."""
_SECOND = 2
"""Index of the drawn seek in runs without learning, from 0: a seek in the positive direction."""


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw one column per length, and one row without feedforward, with it, and after learning."""
    figure = new_figure(
        'Final-state control: effect of friction on arrival, and its compensation', width=9.5, height=7.0
    )
    every = figure.subplots(3, len(LEARNING_LENGTHS), sharex=True, sharey=True)
    for column, length in enumerate(LEARNING_LENGTHS):
        plain, fed, learned = every[:, column]
        plain.set_title(f'{length:g} µm', fontsize=10)
        draw_error(runs, plain, NO_FRICTION[length], _SECOND, color='0.35', label='no friction feedforward')
        for friction in FRICTIONS:
            style = FRICTION_STYLES[friction]
            draw_error(runs, fed, UNLEARNED[length, friction], _SECOND, **style)
            draw_error(runs, learned, LEARNED[length, friction], LEARNED_AFTER, **style)
        learned.set_xlabel('time after the target change [ms]')
    for axes, name in zip(every[:, 0], ('no feedforward', 'feedforward', f'after {LEARNED_AFTER} seeks'), strict=True):
        axes.set_ylabel(f'{name}\nhead - target [nm]')
    every[0, 0].set_ylim(-210.0, 210.0)
    every[0, 0].set_xlim(0.0, _SHOWN)
    every[0, 1].text(_SHOWN, 30.0, '±25 nm ', ha='right', va='bottom', fontsize=8, color='0.4')
    handles, labels = every[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=len(labels), fontsize=9, frameon=False)
    return save(figure, path)


def draw_error(runs: RecordedRuns, axes: Axes, case: Case, number: int, **style: Any) -> None:
    """Draw the position error of the head after target change ``number``, counted from 0."""
    run = runs[case]
    start = round(DWELL * (1 + number) / run.sample_time)
    rows = slice(start, start + round(1e-3 * _SHOWN / run.sample_time) + 1)
    error = 1e3 * (run.position - run.desired_position)[rows]
    axes.plot(1e3 * (run.time[rows] - run.time[start]), error, **{'linewidth': 1.3, **style})
    narrow_band(axes)
