"""
Frequency responses of the default drive (figs. 2.3, 5.3 and 5.4), and convergence of its integration step.

    ros2 run hdd_servo_ros drive_response [DIRECTORY]
    ros2 run hdd_servo_ros drive_response --convergence

The responses are measured on the drive block alone, with a stepped sine, and computed from the fundamental over whole
periods.
"""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.plant import PLANT_STATE, Plant, PlantParameters
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import command
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.studies.friction_curves import SECTION_5_4

Array = npt.NDArray[np.float64]

SAMPLE_TIME = 1.0e-4
AMPLITUDES = (0.01, 0.03, 0.05, 0.1)
"""Amplitudes of the excitation in fig. 5.4 [V]."""
FREQUENCIES = (
    10,
    12,
    15,
    20,
    25,
    30,
    40,
    50,
    60,
    75,
    80,
    90,
    100,
    110,
    120,
    125,
    130,
    140,
    150,
    160,
    180,
    200,
    250,
    300,
)
"""Frequencies of fig. 5.4 and slightly above [Hz]; each has an integer number of samples per second."""
HIGH = (
    400,
    500,
    625,
    800,
    1000,
    1250,
    1600,
    2000,
    2500,
    3125,
    4000,
    *range(4500, 9001, 125),
    *range(9500, 20_001, 500),
)
"""Frequencies of fig. 5.3 above the range of friction, through the four modes [Hz]."""
FAST = 1.0e-5
"""Sample time short enough to avoid aliasing onto the modes [s]."""
SUBSTEPS = (1, 2, 4, 8, 16, 32)
FINE = 512


def write_plots(output_directory: Path) -> list[Path]:
    """Write the plots into a directory, which is created if necessary, and return their paths."""
    output_directory.mkdir(parents=True, exist_ok=True)
    plots = {
        'fig_5_4_amplitude_dependence.png': draw_amplitude_dependence(),
        'fig_5_3_response.png': draw_response(),
    }
    for name, figure in plots.items():
        figure.savefig(output_directory / name, dpi=110)
    return [output_directory / name for name in plots]


def stepped_sine(
    parameters: PlantParameters, amplitude: float, frequencies: Sequence[int], sample_time: float = SAMPLE_TIME
) -> npt.NDArray[np.complex128]:
    """
    Return head position over control [um/V] from the fundamental at each frequency.

    Parameters
    ----------
    parameters
        The drive.
    amplitude
        Amplitude of the control [V].
    frequencies
        Frequencies [Hz]; an integer number of periods, at most one second, spans an integer number of samples.
    sample_time
        T [s].
    """
    return np.array([_fundamental(parameters, amplitude, frequency, sample_time) for frequency in frequencies])


def _fundamental(parameters: PlantParameters, amplitude: float, frequency: int, sample_time: float) -> complex:
    rate = round(1.0 / sample_time)
    block = rate // math.gcd(frequency, rate)
    settle = block * math.ceil(0.25 * rate / block)
    measure = block * math.ceil(0.1 * rate / block)
    phase = np.exp(-2j * np.pi * ((frequency * np.arange(settle + measure)) % rate) / rate)
    control = -amplitude * phase.imag
    plant = Plant(parameters, sample_time)
    head = [plant.output()[0]]
    head += [plant.step(tick, u)[0] for tick, u in enumerate(control[:-1].tolist(), start=1)]
    return complex(np.dot(head[settle:], phase[settle:]) / np.dot(control[settle:], phase[settle:]))


def draw_amplitude_dependence() -> Figure:
    """Draw figs. 2.3 and 5.4: gain and phase at low frequency for four amplitudes of the excitation."""
    parameters = PlantParameters()
    responses = {f'{1e3 * a:g} mV': stepped_sine(parameters, a, FREQUENCIES) for a in AMPLITUDES}
    frequencies = np.array(FREQUENCIES, dtype=np.float64)
    responses['(5.1)'] = (parameters.rigid_gain / (2j * np.pi * frequencies) ** 2).astype(np.complex128)
    return _bode('Default drive: pivot friction at low frequency (figs. 2.3, 5.4)', frequencies, responses)


def draw_response() -> Figure:
    """Draw fig. 5.3: responses of the drive and of the identified model through the four modes."""
    parameters = PlantParameters()
    frequencies = np.array((*FREQUENCIES, *HIGH), dtype=np.float64)
    low = stepped_sine(parameters, 0.05, FREQUENCIES, FAST)
    high = stepped_sine(parameters, 0.5, HIGH, FAST)
    hold = np.sinc(frequencies * FAST) * np.exp(-1j * np.pi * frequencies * FAST)
    model = transfer.frequency_response(parameters, frequencies)
    return _bode(
        'Default drive and its linear model (fig. 5.3)',
        frequencies,
        {
            'block at T = 10 µs, without the hold; 50 mV, and 0.5 V from 400 Hz': np.concatenate([low, high]) / hold,
            '(5.1) to (5.5)': model,
        },
    )


def _bode(title: str, frequencies: Array, responses: dict[str, npt.NDArray[np.complex128]]) -> Figure:
    figure = Figure(figsize=(8.5, 7.0), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    gain, phase = figure.subplots(2, 1, sharex=True)
    for i, (name, response) in enumerate(responses.items()):
        style = {'linewidth': 1.4, 'linestyle': '--' if i and i + 1 == len(responses) else '-'}
        gain.semilogx(frequencies, 20.0 * np.log10(np.abs(response)), label=name, **style)
        degrees = np.degrees(np.unwrap(np.angle(response)))
        # The phase of a double integrator is -180 degrees, not +180.
        phase.semilogx(frequencies, degrees - 360.0 * (degrees[0] > 90.0), **style)
    gain.set_ylabel('gain [dB, µm/V]')
    phase.set_ylabel('phase [°]')
    phase.set_xlabel('frequency [Hz]')
    for axis in (gain, phase):
        axis.grid(which='both', alpha=0.3)
    gain.legend(fontsize=8)
    return figure


def convergence(parameters: PlantParameters, control: Array) -> dict[int, tuple[float, float, float]]:
    """
    Return the errors of position, velocity and bristle deflection relative to their peaks, by number of substeps.

    The reference uses :data:`FINE` substeps; tests compare it with independent solvers.
    """

    def states(substeps: int) -> Array:
        plant = Plant(replace(parameters, substeps=substeps), SAMPLE_TIME)
        rows = []
        for tick, u in enumerate(control.tolist(), start=1):
            plant.step(tick, u)
            state = record(plant.state, PLANT_STATE)
            rows.append((state.position, state.velocity, state.deflection))
        return np.array(rows)

    reference = states(FINE)
    peaks = np.abs(reference).max(axis=0)
    errors = {}
    for substeps in SUBSTEPS:
        x, v, z = (np.abs(states(substeps) - reference).max(axis=0) / peaks).tolist()
        errors[substeps] = (x, v, z)
    return errors


def print_convergence(write: Callable[[str], None] = print) -> None:
    """Print the convergence on three motions, as the tables of ``docs/results/validation.md``."""
    time = SAMPLE_TIME * np.arange(100_000)
    motions = {
        'section 5.4, u = 5 sin t, 10 s': (SECTION_5_4, 5.0 * np.sin(time)),
        'default drive, 0.1 V at 80 Hz (presliding), 0.1 s': (
            PlantParameters(),
            0.1 * np.sin(2.0 * np.pi * 80.0 * time[:1000]),
        ),
        'default drive, 0.3 V at 70 Hz (sliding), 0.1 s': (
            PlantParameters(),
            0.3 * np.sin(2.0 * np.pi * 70.0 * time[:1000]),
        ),
    }
    for name, (parameters, control) in motions.items():
        write(f'{name}\n')
        write('| substeps | position | velocity | bristle |')
        write('|---|---|---|---|')
        for substeps, errors in convergence(parameters, control).items():
            write(f'| {substeps} | ' + ' | '.join(f'{error:.1e}' for error in errors) + ' |')
        write('')


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='drive_response',
        description="Draw the default drive's frequency responses (figs. 2.3, 5.3 and 5.4) as PNG files.",
        epilog='Exit code: 0 done, 1 a file cannot be written, 2 invalid arguments.',
    )
    parser.add_argument(
        'directory', nargs='?', type=Path, default=Path('runs/drive_response'), help='default: %(default)s'
    )
    parser.add_argument(
        '--convergence', action='store_true', help='print the convergence of the integration step instead'
    )
    return parser


@command('drive_response')
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the plots or print the convergence; exit code 0 done, 1 a file cannot be written."""
    options = command_line().parse_args(arguments)
    if options.convergence:
        print_convergence()
        return 0
    for path in write_plots(options.directory):
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
