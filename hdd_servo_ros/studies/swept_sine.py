"""
Frequency response of a recorded sweep, and its identification by Levy's method and by its iterative refinement.

    ros2 run hdd_servo_ros swept_sine RUN [--noise 0.01]

The command computes the response from the bag and replaces `response.csv` and `response.png` in the run directory;
`response.png` shows the identified model over the measurement (fig. 5.3). It prints a table of the true and the
identified gain and modes.
"""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.identification import identify_measured
from hdd_servo_ros.analysis.rational_fit import LEVY, METHODS
from hdd_servo_ros.analysis.transfer_model import Model
from hdd_servo_ros.bench.response import FrequencyResponse, held
from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, command, reading
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.bode import bode
from hdd_servo_ros.reporting.recorded_response import node_parameters, response_of_run
from hdd_servo_ros.reporting.response import CSV, PICTURE, describe

FROM = 400.0
"""Lowest frequency used [Hz]; below it, the response depends on the amplitude because of friction."""
ZEROS = 4
"""Number of zeros: those of (5.2) and (5.3) together."""
POLES = 10
"""Number of poles of (5.1) to (5.5)."""


def with_noise(measured: FrequencyResponse, level: float, seed: int) -> FrequencyResponse:
    """Return a measurement with complex noise of rms ``level`` times the magnitude at each point, and no coherence."""
    rng = np.random.default_rng(seed)
    count = len(measured.frequency)
    noise = (rng.normal(size=count) + 1j * rng.normal(size=count)) / np.sqrt(2.0)
    return dataclasses.replace(
        measured,
        response=measured.response * (1.0 + level * noise),
        coherence=np.ones(count),
        averages=np.ones(count, dtype=np.int64),
    )


def true_modes(parameters: PlantParameters) -> list[tuple[float, float]]:
    """Return natural frequency [Hz] and damping ratio of the resonances of the drive, in order of frequency."""
    poles = np.roots(transfer.resonance(parameters.resonance_at_temperature)[1])
    upper = sorted(poles[poles.imag > 0.0], key=abs)
    return [(abs(pole) / (2.0 * np.pi), -pole.real / abs(pole)) for pole in upper]


def compare(parameters: PlantParameters, models: Mapping[str, Model]) -> str:
    """Return a Markdown table of the true and the identified gain and modes, with the deviations in parentheses."""
    found = {name: ([mode for mode in model.modes() if mode.pole.imag > 0.0], model) for name, model in models.items()}
    rows = [['', 'true', *found]]
    gain = parameters.rigid_gain
    rows.append(['gain', f'{gain:.5g}', *(_deviation(model.rigid_gain(), gain, 5) for _, model in found.values())])
    true = true_modes(parameters)
    for i, (frequency, damping) in enumerate(true):
        # Take the pairs of highest frequency: a pair below them is the rigid body on the friction stiffness.
        modes = [pairs[len(pairs) - len(true) + i] if len(pairs) >= len(true) else None for pairs, _ in found.values()]
        rows.append(
            [
                f'mode {i + 1} [Hz]',
                f'{frequency:.1f}',
                *(_deviation(mode.frequency if mode else None, frequency, 6) for mode in modes),
            ]
        )
        rows.append(
            ['damping', f'{damping:.5f}', *(_deviation(mode.damping if mode else None, damping, 4) for mode in modes)]
        )
    lines = ['| ' + ' | '.join(row) + ' |' for row in rows]
    return '\n'.join([lines[0], '|---' * len(rows[0]) + '|', *lines[1:]])


def _deviation(found: float | None, true: float, digits: int) -> str:
    if found is None:
        return 'not found'
    return f'{found:.{digits}g} ({100.0 * (found / true - 1.0):+.2g} %)'


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='swept_sine',
        description='Compute the frequency response of a recorded sweep from its bag (response.csv and response.png in '
        'the run directory), and compare the models identified by two methods with the true drive.',
        epilog='Exit code: 0 done, 1 a file cannot be written, 2 invalid arguments, 3 the run is not a sweep or cannot '
        'be read.',
    )
    parser.add_argument('run', type=Path, help='run directory of signal_analyzer')
    parser.add_argument(
        '--noise', type=float, default=0.0, help='relative rms of the noise added before the identification'
    )
    parser.add_argument('--seed', type=int, default=0, help='seed of that noise')
    parser.add_argument('--from', type=float, default=FROM, dest='lowest', metavar='HZ', help='lowest frequency used')
    return parser


@command('swept_sine', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Identify the drive from one run; exit code 3 not a sweep or unreadable, 1 a file cannot be written."""
    given = command_line().parse_args(arguments)
    with reading(given.run):
        run = RecordedRun.open(given.run)
        measured = response_of_run(run)
        plant = block_parameters('vcm_plant', node_parameters(run, 'vcm_plant'))
        used = measured.between(given.lowest, np.inf)
        if given.noise:
            used = with_noise(used, given.noise, given.seed)
        models = {method: identify_measured(used, POLES, ZEROS, method=method) for method in (LEVY, METHODS[0])}
        fitted = models[METHODS[0]].response(measured.frequency) * held(measured.frequency, measured.hold)
    measured.write_csv(given.run / CSV)
    curves = {'measured': measured, 'identified': FrequencyResponse.of(measured.frequency, fitted)}
    bode(curves).savefig(given.run / PICTURE, dpi=100)
    print(describe(measured))
    print(compare(plant, models))
    print(f'written: {given.run / CSV}, {given.run / PICTURE}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
