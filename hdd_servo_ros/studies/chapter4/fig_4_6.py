"""Fig. 4.6: the estimates sigma_hat, phi_hat and m_hat."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import NN
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

CASES = (NN,)
_TRUE_MASS = 1.0


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the three estimates."""
    run = runs[NN]
    figure = new_figure('Fig. 4.6: estimates, λ = 1 1/s', height=6.0)
    axes = figure.subplots(3, 1, sharex=True)
    for axis, name, label in zip(
        axes,
        ('sigma_hat', 'phi_hat', 'm_hat'),
        ('sigma_hat [N s/m]', 'phi_hat [N]', 'm_hat [kg]'),
        strict=True,
    ):
        draw(axis, run.time, run.estimates[name])
        axis.set_ylabel(label)
    axes[2].axhline(_TRUE_MASS, color='0.3', linestyle='--', linewidth=1.0, label='true mass')
    axes[2].set_xlabel('time [s]')
    legend_above(axes[2])
    return save(figure, path)
