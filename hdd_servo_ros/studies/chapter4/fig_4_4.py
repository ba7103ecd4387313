"""Fig. 4.4: control of the adaptive NN controller and of PID."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_PERIODS, NN, PID
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

CASES = (NN, PID)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the control over the first second, the whole run and its last two periods."""
    figure = new_figure('Fig. 4.4: control, λ = 1 1/s; PID tuned to the same peak')
    axes = figure.subplots(3, 1)
    for axis, start, end in zip(axes, (0.0, 0.0, LAST_PERIODS), (1.0, 20.0, 20.0), strict=True):
        for case, label, color in ((PID, 'PID', 'C1'), (NN, 'adaptive NN', 'C0')):
            run = runs[case]
            window = slice(run.since(start).start, run.since(end).start + 1)
            label = f'{label}: at most {runs.metrics(case, 0.0).peak_control:.1f} N'
            draw(axis, run.time[window], run.command[window], color=color, label=label)
        axis.set_ylabel('control [N]')
    axes[-1].set_xlabel('time [s]')
    legend_above(axes[0])
    return save(figure, path)
