"""
`identify`: identification of a transfer function from the CSV file of a measured frequency response.

    ros2 run hdd_servo_ros identify FILE.csv [--poles 10 --zeros 4]
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.identification import doubts, identify_measured
from hdd_servo_ros.analysis.rational_fit import LEVY, METHODS, SANATHANAN_KOERNER, least_points
from hdd_servo_ros.analysis.transfer_model import Model
from hdd_servo_ros.bench.response import FrequencyResponse, read_csv, reject_hold
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, command, reading


def _count(text: str) -> int:
    """Parse a non-negative integer; raise ArgumentTypeError otherwise."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f'{number} is invalid; expected at least 0')
    return number


def _positive_count(text: str) -> int:
    """Parse a positive integer; raise ArgumentTypeError otherwise."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f'{number} is invalid; expected at least 1')
    return number


def _time(text: str) -> float:
    """Parse a non-negative time [s]; raise ArgumentTypeError otherwise."""
    number = float(text)
    if not 0.0 <= number < np.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a time; expected a finite number at least 0 [s]')
    return number


def _frequency(text: str) -> float:
    """Parse a non-negative frequency [Hz]; raise ArgumentTypeError otherwise."""
    number = float(text)
    if not number >= 0.0:
        raise argparse.ArgumentTypeError(f'{text} is not a frequency; expected a number at least 0 [Hz]')
    return number


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='identify',
        description='Fit a transfer function to a CSV file of frequency, magnitude and phase (thesis section 3.3).',
        epilog='Exit code: 0 success, 2 invalid arguments, 3 the file cannot be read or identified.',
    )
    parser.add_argument('file', type=Path, help='CSV with named units, as from signal_analyzer, or Hz, linear, deg')
    parser.add_argument('--poles', type=_positive_count, help='number of poles (default: selected by the residual)')
    parser.add_argument('--zeros', type=_count, help='number of zeros, with --poles (default: 0)')
    parser.add_argument('--integrators', type=_count, default=0, help='number of poles fixed at 0 in the fit')
    parser.add_argument(
        '--rigid-order',
        type=int,
        choices=(2, 0),
        default=2,
        help='number of fitted poles of least magnitude that the printed gain counts as the rigid body: 2, or 0 for '
        'the static gain; does not affect the fit, but must be at least --integrators',
    )
    parser.add_argument(
        '--from', type=_frequency, default=0.0, dest='lowest', metavar='HZ', help='lowest frequency used'
    )
    parser.add_argument(
        '--to', type=_frequency, default=np.inf, dest='highest', metavar='HZ', help='highest frequency used'
    )
    parser.add_argument('--hold', type=_time, help='hold in the response [s], overrides the file; 0 for none')
    parser.add_argument('--delay', type=_time, default=0.0, help='computation delay in the response [s]')
    parser.add_argument('--method', choices=METHODS, default=SANATHANAN_KOERNER)
    return parser


@command('identify', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Identify the response in a CSV file and print gain and modes; exit code 3 if that fails."""
    parser = command_line()
    given = parser.parse_args(arguments)
    if given.method == LEVY and given.poles is None:
        parser.error('--method levy needs --poles: the order selection uses iterated fits')
    if given.zeros is not None and given.poles is None:
        parser.error('--zeros needs --poles: without it both numbers are selected by the residual')
    if given.integrators > given.rigid_order:
        parser.error(f'--integrators {given.integrators} exceeds --rigid-order {given.rigid_order}')
    if given.lowest > given.highest:
        parser.error(f'--from {given.lowest:g} is above --to {given.highest:g}')
    zeros = given.zeros or 0
    with reading(given.file):
        measured = _used(given, zeros)
        model = identify_measured(
            measured,
            given.poles,
            zeros,
            integrators=given.integrators,
            delay=given.delay,
            method=given.method,
        )
    for line in doubts(model, measured, given.rigid_order):
        print(f'identify: warning: {line}', file=sys.stderr)
    print(table(model, given.rigid_order, measured.unit), flush=True)
    return 0


def _used(given: argparse.Namespace, zeros: int) -> FrequencyResponse:
    """Return the points of the file within the options; raises ValueError if they are too few."""
    recorded = read_csv(given.file)
    measured = recorded.between(given.lowest, given.highest)
    least = least_points(given.poles, zeros, given.integrators)
    if len(measured.frequency) < least:
        wanted = 'to select an order' if given.poles is None else f'for {given.poles} poles and {zeros} zeros'
        limits = {f'--from {given.lowest:g}': given.lowest > 0.0, f'--to {given.highest:g}': given.highest < np.inf}
        given_limits = ' '.join(option for option, is_given in limits.items() if is_given)
        leaves = f'{given_limits} leaves ' if given_limits else ''
        first, last = recorded.frequency[[0, -1]]
        raise ValueError(
            f'{given.file}: {leaves}{len(measured.frequency)} of {len(recorded.frequency)} points '
            f'from {first:.6g} to {last:.6g} Hz, expected at least {least} {wanted}'
        )
    if given.hold is None:
        return measured
    reject_hold(given.hold, float(measured.frequency.max()), '--hold')
    return dataclasses.replace(measured, hold=given.hold)


def table(model: Model, rigid_order: int = 2, unit: str = '') -> str:
    """
    Return gain and modes as text.

    Parameters
    ----------
    model
        The model.
    rigid_order
        See :meth:`Model.rigid_gain`.
    unit
        Unit of the response; empty if it is unknown.
    """
    unit = unit or 'magnitude'
    residue_unit = f'{unit} rad/s'
    width = max(12, len(residue_unit) + 12)
    lines = [
        f'{len(model.poles)} poles, {len(model.zeros)} zeros; weighted rms error {model.error:.3g}',
        f'gain of the rigid body {model.rigid_gain(rigid_order):.6g} {_per_second(unit, rigid_order)} '
        f'(poles of least magnitude: {rigid_order})',
        f'{"frequency [Hz]":>16} {"damping":>10} {f"|residue| [{residue_unit}]":>{width}} {"phase [deg]":>12}',
    ]
    lines += [
        f'{mode.frequency:16.2f} {mode.damping:10.5f} {abs(mode.residue):{width}.5g} '
        f'{np.degrees(np.angle(mode.residue)):12.1f}'
        for mode in model.modes()
    ]
    return '\n'.join(lines)


def _per_second(unit: str, order: int) -> str:
    """Return a unit divided by s to the power of ``order``."""
    if order == 0:
        return unit
    above, slash, below = unit.partition('/')
    return f'{above}/({below} s^{order})' if slash else f'{unit}/s^{order}'


if __name__ == '__main__':
    sys.exit(main())
