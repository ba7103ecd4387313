"""Fig. 4.5: norm of the network weights, and contribution of the network to the control."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN
from hdd_servo_ros.studies.output import draw, new_figure, save

CASES = (NN,)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the norm of the weights and the output of the network; the title compares it with the control."""
    run = runs[NN]
    output = run.estimates['network']
    largest = abs(output[run.since(LAST_HALF)]).max()
    control = runs.metrics(NN, LAST_HALF).rms_control
    figure = new_figure(
        f'Fig. 4.5: weights, λ = 1 1/s; in the last half, network output at most {largest:.3f} N, '
        f'control {control:.1f} N rms'
    )
    norm, network = figure.subplots(2, 1, sharex=True)
    draw(norm, run.time, run.estimates['W_norm'])
    draw(network, run.time, output, color='C2')
    norm.set_ylabel('‖W‖ [N]')
    network.set_ylabel("W'S [N]")
    network.set_xlabel('time [s]')
    return save(figure, path)
