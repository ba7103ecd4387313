"""Error over time in rotational vibration, after the feedforward has adapted."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, IN_VIBRATION, TRANSIENT
from hdd_servo_ros.studies.mobile.drawing import STYLES, error
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

SHOWN = 0.15
"""Drawn duration [s]."""
_METHODS = ('none', 'fixed', 'fxlms')
CASES = tuple(IN_VIBRATION[controller][method] for controller in CONTROLLERS for method in _METHODS)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the base acceleration, and the errors of both controllers below it."""
    figure = new_figure('Rotational vibration: base acceleration and head error', height=6.5)
    top, *others = figure.subplots(3, 1, sharex=True)
    for axes, (controller, name) in zip(others, CONTROLLERS.items(), strict=True):
        for method in _METHODS:
            run = runs[IN_VIBRATION[controller][method]]
            rows = (run.time >= TRANSIENT) & (run.time <= TRANSIENT + SHOWN)
            draw(axes, run.time[rows], error(run)[rows], **STYLES[method])
        axes.set_ylabel(f'{name}: error [nm]')
        draw(top, run.time[rows], run['base_acceleration'][rows, 5], color='C7')
    top.set_ylabel('base [rad/s²]')
    legend_above(others[0])
    others[-1].set_xlabel('time [s]')
    return save(figure, path)
