"""Fig. 4.3: output tracking of the adaptive NN controller and of PID."""

from pathlib import Path

from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN, PID
from hdd_servo_ros.studies.output import draw, new_figure, save
from hdd_servo_ros.studies.recorded import RecordedRuns

CASES = (NN, PID)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw positions and errors of both."""
    figure = new_figure('Fig. 4.3: output tracking, λ = 1; PID with the same peak control')
    position, error = figure.subplots(2, 1, sharex=True)
    for case, label, color in ((PID, 'PID', 'C1'), (NN, 'adaptive NN', 'C0')):
        signals = runs.signals(case)
        x, x_d = signals.head[:, 0], signals.reference[:, 0]
        rms = runs.metrics(case, LAST_HALF).rms_error
        draw(position, signals.time, x, color=color, label=label)
        draw(error, signals.time, x - x_d, color=color, label=f'{label}: {1e3 * rms:.2f} mm rms in the last half')
    draw(position, signals.time, x_d, color='0.2', linestyle=':', label='reference')
    position.set_ylabel('position [m]')
    error.set_ylabel('error [m]')
    error.set_xlabel('time [s]')
    for axes in (position, error):
        axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8, frameon=False)
    return save(figure, path)
