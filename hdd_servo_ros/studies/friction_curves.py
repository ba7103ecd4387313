"""
Plots of the friction curves of figs. 2.1, 2.2 and 5.5.

    ros2 run hdd_servo_ros friction_curves [DIRECTORY]
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hdd_servo_ros.drive.friction.curves import friction_along, friction_curve
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import command

Array = npt.NDArray[np.float64]

SAMPLE_TIME = 1.0e-4
"""T of section 5.4 [s]."""

SLIDING_AMPLITUDE = 5.0
"""Amplitude of u = 5 sin t, section 5.4 [N]."""
SLIDING_FREQUENCY = 0.15915494309189535
"""Frequency of u = 5 sin t, 1/(2 pi) [Hz]."""
SLIDING_DURATION = 12.6
"""Two periods [s]."""
PRESLIDING_AMPLITUDES = (0.9, 0.6, 0.3)
"""Amplitudes of sines below the breakaway force [N]."""
PRESLIDING_FREQUENCY = 2.0
"""Frequency of these sines [Hz]."""
PRESLIDING_DURATION = 1.5
"""Three periods [s]."""

SECTION_5_4 = PlantParameters(
    gain=1.0,
    control_limit=100.0,
    length_unit='m',
    control_unit='N',
    friction=FrictionParameters(
        model='lugre',
        stiffness=1.0e5,
        bristle_damping=1.0e5**0.5,
        viscous_coefficient=0.4,
        coulomb_level=1.0,
        static_level=1.5,
        stribeck_velocity=0.001,
    ),
    resonance=ResonanceParameters(form='none'),
)
"""Mass with friction of section 5.4, in SI units."""

STATIC = FrictionParameters(
    coulomb_level=1.0,
    static_level=1.5,
    stribeck_velocity=0.25,
    stribeck_exponent=1.5,
    viscous_coefficient=0.3,
    second_break_level=0.2,
    second_stribeck_velocity=1.0,
    first_offset_velocity=0.1,
    second_offset_velocity=0.5,
    square_root_coefficient=-0.6,
    drag_coefficient=0.05,
)
"""Illustrative values that show the shapes of the curves."""


def write_plots(output_directory: Path) -> list[Path]:
    """Write the plots into a directory, which is created if necessary, and return their paths."""
    output_directory.mkdir(parents=True, exist_ok=True)
    plots = {
        'fig_2_1_static_friction.png': draw_static_friction(),
        'fig_2_2_dahl.png': draw_dahl(),
        'fig_5_5_lugre_hysteresis.png': draw_lugre_hysteresis(
            simulate_sine(SLIDING_AMPLITUDE, SLIDING_FREQUENCY, SLIDING_DURATION),
            {
                amplitude: simulate_sine(amplitude, PRESLIDING_FREQUENCY, PRESLIDING_DURATION)
                for amplitude in PRESLIDING_AMPLITUDES
            },
        ),
    }
    for name, figure in plots.items():
        figure.savefig(output_directory / name, dpi=110)
    return [output_directory / name for name in plots]


def draw_static_friction() -> Figure:
    """Draw fig. 2.1 (Coulomb friction, Coulomb and viscous friction) and, next to it, the Stribeck curves."""
    figure, axes = _figure(3, 'Static friction over velocity (fig. 2.1)')
    velocity = np.linspace(-2.0, 2.0, 2001)
    panels = (
        ('(a) Coulomb (2.3)', ('coulomb',)),
        ('(b) Coulomb and viscous (2.3), (2.4)', ('coulomb_viscous',)),
        (
            'Stribeck curves (2.6)-(2.12)',
            ('exponential', 'gaussian', 'gaussian_two_breaks_offsets', 'tustin', 'lorentzian', 'square_root'),
        ),
    )
    for axis, (title, models) in zip(axes, panels, strict=True):
        for model in models:
            curve = friction_curve(replace(STATIC, model=model), velocity)
            axis.plot(velocity, curve, label=model.replace('_', ' '), linewidth=1.3)
        _label(axis, title, 'velocity', 'friction')
    axes[2].legend(fontsize=6.5, loc='lower right', handlelength=1.2)
    return figure


def draw_dahl() -> Figure:
    """Draw fig. 2.2: friction over displacement of the Dahl model during loading, unloading and reloading."""
    figure, axes = _figure(2, "Dahl's model: friction over displacement (fig. 2.2)")
    path = _there_and_back([0.0, 5.0, -5.0, 5.0], 400)
    for exponent in (0.5, 1.0, 2.0, 4.0):
        friction = _dahl(exponent)
        axes[0].plot(path, friction_along(friction, path, 1.0), label=f'$\\alpha$ = {exponent:g}', linewidth=1.2)
    inner = _there_and_back([0.0, 4.0, -1.0, 2.0, 0.0, 4.0], 400)
    axes[1].plot(inner, friction_along(_dahl(1.0), inner, 1.0), linewidth=1.2)
    _label(axes[0], 'any exponent (2.16)', 'displacement / ($f_c/\\sigma$)', 'friction / $f_c$')
    _label(axes[1], 'inner loops, $\\alpha$ = 1', 'displacement / ($f_c/\\sigma$)', 'friction / $f_c$')
    axes[0].set_ylim(-1.1, 1.6)
    axes[0].legend(fontsize=8, loc='upper center', ncols=4, columnspacing=1.0, handlelength=1.2)
    return figure


def draw_lugre_hysteresis(sliding: Array, presliding: Mapping[float, Array]) -> Figure:
    """
    Draw fig. 5.5: the LuGre model of section 5.4 in sliding and, below breakaway, in presliding.

    Parameters
    ----------
    sliding
        Rows of position [m], velocity [m/s] and friction [N] under u = 5 sin t.
    presliding
        The same under sines of ``PRESLIDING_FREQUENCY``, by amplitude [N]; the first third is not drawn.
    """
    figure, axes = _figure(3, 'LuGre hysteresis, parameters of section 5.4 (fig. 5.5)')
    axes[0].plot(sliding[:, 0], sliding[:, 2], linewidth=1.0)
    _label(axes[0], 'u = 5 sin t', 'position [m]', 'friction [N]')
    slow = np.abs(sliding[:, 1]) < 0.02
    axes[1].plot(1e3 * sliding[slow, 1], sliding[slow, 2], '.', markersize=1.5)
    _label(axes[1], 'detail around zero velocity', 'velocity [mm/s]', 'friction [N]')
    for amplitude, rows in presliding.items():
        settled = rows[len(rows) // 3 :]
        axes[2].plot(1e6 * settled[:, 0], settled[:, 2], label=f'u = {amplitude} sin 4$\\pi$t', linewidth=1.0)
    _label(axes[2], 'presliding, below $f_s$ = 1.5 N', 'position [µm]', 'friction [N]')
    axes[2].legend(fontsize=7, loc='upper left')
    return figure


def simulate_sine(amplitude: float, frequency: float, duration: float) -> Array:
    """Return the result of :func:`simulate` for a sine with amplitude [N] and frequency [Hz]."""
    time = SAMPLE_TIME * np.arange(round(duration / SAMPLE_TIME))
    return simulate(amplitude * np.sin(2.0 * np.pi * frequency * time))


def simulate(control: Array) -> Array:
    """Return position [m], velocity [m/s] and friction [N] of the mass of section 5.4 under a sampled force [N]."""
    plant = Plant(SECTION_5_4, SAMPLE_TIME)
    rows = [plant.output()]
    rows += [plant.step(tick, force) for tick, force in enumerate(control.tolist(), start=1)]
    return np.array(rows)


def _dahl(exponent: float) -> FrictionParameters:
    return FrictionParameters(model='dahl', stiffness=1.0, coulomb_level=1.0, dahl_exponent=exponent)


def _there_and_back(corners: Sequence[float], count: int) -> Array:
    return np.interp(np.linspace(0.0, len(corners) - 1, count * (len(corners) - 1) + 1), range(len(corners)), corners)


def _figure(panels: int, title: str) -> tuple[Figure, Sequence[Axes]]:
    # Not pyplot: writing a file needs no display.
    figure = Figure(figsize=(4.4 * panels, 3.9), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    return figure, list(np.atleast_1d(figure.subplots(1, panels)))


def _label(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set_title(title, fontsize=10)
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(alpha=0.3)


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='friction_curves',
        description='Draw the friction curves of figs. 2.1, 2.2 and 5.5 as PNG files.',
        epilog='Exit code: 0 done, 1 a file cannot be written, 2 invalid arguments.',
    )
    parser.add_argument(
        'directory', nargs='?', type=Path, default=Path('runs/friction_curves'), help='default: %(default)s'
    )
    return parser


@command('friction_curves')
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the plots; exit code 0 done, 1 a file cannot be written."""
    directory = command_line().parse_args(arguments).directory
    for path in write_plots(directory):
        print(path)
    return 0


if __name__ == '__main__':
    sys.exit(main())
