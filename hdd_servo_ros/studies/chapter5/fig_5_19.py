"""Fig. 5.19: tracking error on 5 µm steps for different lambda."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import LAMBDA_INTEGRAL_STEPS, LAMBDA_STEPS
from hdd_servo_ros.studies.chapter5.step_figures import edge_window
from hdd_servo_ros.studies.output import draw, new_figure, save

CASES = (*LAMBDA_STEPS.values(), *LAMBDA_INTEGRAL_STEPS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the error after one edge with the law of the thesis, and with integral action."""
    figure = new_figure('Fig. 5.19: tracking error on steps of 5 µm', height=5.5)
    every = figure.subplots(2, 1, sharex=True)
    titles = ('law of the thesis, fixed k', r'with integral action, $\lambda_i = 0.138\,\lambda^2$')
    for axes, title, cases in zip(every, titles, (LAMBDA_STEPS, LAMBDA_INTEGRAL_STEPS), strict=True):
        for value, case in cases.items():
            run = runs[case]
            milliseconds, shown = edge_window(run.time)
            error = run.error[shown]
            draw(axes, milliseconds, error, label=rf'$\lambda$ = {value:g} 1/s')
        axes.set_title(title, fontsize=9)
        axes.set_ylabel('error [µm]')
    every[0].legend(fontsize=8, loc='lower right')
    every[-1].set_xlabel('time after the edge [ms]')
    return save(figure, path)
