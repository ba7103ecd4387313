"""Fig. 4.3: output tracking of the adaptive NN controller and of PID with the same peak control."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN, PID
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

CASES = (NN, PID)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw positions and errors of both controllers."""
    figure = new_figure('Fig. 4.3: output tracking, λ = 1 1/s')
    position, error = figure.subplots(2, 1, sharex=True)
    for case, label, color in ((PID, 'PID', 'C1'), (NN, 'adaptive NN', 'C0')):
        run = runs[case]
        rms = runs.metrics(case, LAST_HALF).rms_error
        draw(position, run.time, run.position, color=color, label=label)
        text = f'{label}: {1e3 * rms:.2f} mm rms in the last half'
        draw(error, run.time, 1e3 * run.error, color=color, label=text)
    draw(position, run.time, run.desired_position, color='0.2', linestyle=':', label='reference')
    position.set_ylabel('position [m]')
    error.set_ylabel('error [mm]')
    error.set_xlabel('time [s]')
    legend_above(position, error)
    return save(figure, path)
