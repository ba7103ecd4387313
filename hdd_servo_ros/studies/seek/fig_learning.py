"""Learning over seeks: time into +-25 nm and learned friction scale over the seek number."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.output import new_figure, save
from hdd_servo_ros.studies.seek.cases import FRICTIONS, LEARNED, LEARNED_AFTER, LEARNING_LENGTHS, NARROW_LIMITS
from hdd_servo_ros.studies.seek.drawing import FRICTION_STYLES
from hdd_servo_ros.studies.seek.learning import levels, narrow_times

CASES = tuple(LEARNED.values())
_TIMES = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw one column per length, with the time above and the friction scale below."""
    figure = new_figure('Seeks back and forth, with friction learned from the feedback output', width=9.5, height=5.6)
    every = figure.subplots(2, len(LEARNING_LENGTHS), sharex=True, sharey='row')
    for column, length in enumerate(LEARNING_LENGTHS):
        upper, lower = every[:, column]
        upper.set_title(f'{length:g} µm', fontsize=10)
        for friction in FRICTIONS:
            case, style = LEARNED[length, friction], {**FRICTION_STYLES[friction], 'linewidth': 1.2, 'markersize': 3.5}
            times, level = narrow_times(runs, case), levels(runs, case)
            number = np.arange(1, len(times) + 1)
            upper.plot(number, times, 'o-', **style)
            lower.plot(number, level, 'o-', **style)
            lower.axhline(friction, color=style['color'], linewidth=0.8, linestyle=':')
        upper.axhline(NARROW_LIMITS[length][1], xmin=0.66, color='black', linewidth=1.0, linestyle='--')
        upper.text(30.0, 1.06 * NARROW_LIMITS[length][1], 'limit', ha='right', va='bottom', fontsize=8)
        upper.axvline(LEARNED_AFTER + 0.5, color='0.6', linewidth=0.8)
        upper.set_yscale('log')
        upper.set_yticks(_TIMES, [f'{time:g}' for time in _TIMES])
        upper.minorticks_off()
        upper.set_ylim(0.6, 20.0)
        lower.set_xlabel('seek number')
    every[0, 0].set_ylabel('time into ±25 nm [ms]')
    every[1, 0].set_ylabel('learned friction\n/ model')
    handles, labels = every[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=len(labels), fontsize=9, frameon=False)
    return save(figure, path)
