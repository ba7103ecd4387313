"""Fig. 4.7: tracking errors for different lambda."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAMBDAS, LAST_HALF, LAST_PERIODS, NN_BY_LAMBDA
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

CASES = tuple(NN_BY_LAMBDA.values())
_DRAWN = (0.1, 1.0, 5.0, 15.0)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the errors over time, and rms error and peak control over lambda."""
    figure = new_figure('Fig. 4.7: tracking error with different λ', height=7.0)
    axes = figure.subplot_mosaic([['whole', 'whole'], ['late', 'sweep']])
    for value in _DRAWN:
        run = runs[NN_BY_LAMBDA[value]]
        error = 1e3 * run.error
        late = run.since(LAST_PERIODS)
        draw(axes['whole'], run.time, error, label=f'λ = {value:g} 1/s')
        if value > _DRAWN[0]:
            draw(axes['late'], run.time[late], error[late], color=axes['whole'].lines[-1].get_color())
    found = [runs.metrics(NN_BY_LAMBDA[value], LAST_HALF) for value in LAMBDAS]
    sweep = axes['sweep']
    sweep.loglog(LAMBDAS, [1e3 * metrics.rms_error for metrics in found], 'o-', label='rms error, last half [mm]')
    sweep.loglog(LAMBDAS, [metrics.peak_control for metrics in found], 's--', color='C3', label='peak control [N]')
    sweep.set_xlabel('λ [1/s]')
    for name in ('whole', 'late'):
        axes[name].set_ylabel('error [mm]')
        axes[name].set_xlabel('time [s]')
    axes['late'].set_title(f'without λ = {_DRAWN[0]:g} 1/s', loc='left', fontsize=8)
    legend_above(axes['whole'], sweep)
    return save(figure, path)
