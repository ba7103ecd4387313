"""
Print the effect of each instrument on the tracking error: the tables of docs/results/validation.md.

    ros2 run hdd_servo_ros instruments [--params-file FILE ...] [--seconds 12]
"""

import argparse
import sys
from collections.abc import Mapping, Sequence

from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import command
from hdd_servo_ros.parameters.files import ArgumentError, read_parameter_files
from hdd_servo_ros.parameters.run_parameters import TimerParameters
from hdd_servo_ros.studies.tuning_runs import AMPLITUDE, FREQUENCIES, TRANSIENT, Sections, track

CONTROLLERS = ('adaptive_nn', 'pid')

LDV_EFFECTS: tuple[tuple[str, dict[str, object]], ...] = (
    ('default: 3 nm, 3 um/s, 16 bits', {}),
    ('no noise', {'noise': False}),
    ('ideal ADC', {'adc_bits': 0}),
    ('no noise, ideal ADC', {'noise': False, 'adc_bits': 0}),
    ('10 times the noise', {'displacement_noise': 0.03, 'velocity_noise': 30.0}),
    ('noise below 1 kHz', {'noise_bandwidth': 1000.0}),
    ('density, up to 20 kHz', {'noise_measure': 'density', 'noise_bandwidth': 20000.0}),
    ('ADC of 12 bits', {'adc_bits': 12}),
    ('demodulator delay of 1 us', {'demodulator_delay': 1.0e-6}),
    ('demodulator delay of 10 us', {'demodulator_delay': 1.0e-5}),
    ('low pass of 100 kHz', {'demodulator_bandwidth': 1.0e5}),
    ('low pass of 20 kHz', {'demodulator_bandwidth': 2.0e4}),
    ('10 drop-outs per second, held', {'dropout_rate': 10.0}),
    ('10 drop-outs per second, zero', {'dropout_rate': 10.0, 'dropout_effect': 'zero'}),
)
DSP_EFFECTS: tuple[tuple[str, dict[str, object]], ...] = (
    ('DAC of 16 bits, 10 V', {'dsp.dac_bits': 16, 'dsp.dac_range': 10.0}),
    ('DAC of 12 bits, 10 V', {'dsp.dac_bits': 12, 'dsp.dac_range': 10.0}),
    ('computation delay of one sample', {'dsp.computation_delay': 1}),
)
# Whether the sensor has noise, and whether the reference is filtered.
DIFFERENCES = ((True, True), (False, True), (True, False), (False, False))


def errors(sections: Sections, sample_time: float, seconds: float) -> list[str]:
    """
    Return rms and maximum error [nm] on a 2 µm sine after the transient, for each controller and frequency.

    If the rms error is not below the amplitude of the sine, the loop is reported as ``unstable``.
    """
    texts = []
    for controller in CONTROLLERS:
        for frequency in FREQUENCIES:
            found = track(controller, {}, sections, sample_time, frequency, seconds, TRANSIENT)
            stable = found.rms_error < 1e3 * AMPLITUDE  # false for NaN
            texts.append('unstable' if not stable else f'{found.rms_error:.1f} / {found.max_error:.1f}')
    return texts


def with_values(sections: Sections, **values: Mapping[str, object]) -> Sections:
    """Return sections with the parameters of some nodes overridden by ``values``."""
    return {**sections, **{node: {**sections.get(node, {}), **own} for node, own in values.items()}}


def _with_controllers(sections: Sections, values: Mapping[str, object]) -> Sections:
    return with_values(sections, **{f'{controller}_controller': values for controller in CONTROLLERS})


def _print_row(cells: Sequence[str]) -> None:
    print('| ' + ' | '.join(cells) + ' |', flush=True)


def _print_head(first: str) -> None:
    names = [f'{name} {f:g} Hz' for name in ('adaptive NN', 'PID') for f in FREQUENCIES]
    _print_row([first, *names])
    _print_row(['---'] * (1 + len(names)))


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='instruments',
        description='Tabulate the effect of each instrument of the bench on the tracking error of the adaptive NN and '
        f'the PID controller: rms and maximum on 2 um sines of 100 and 200 Hz, after the first {TRANSIENT:g} s.',
        epilog='Exit code: 0 done, 2 invalid arguments or parameters.',
    )
    parser.add_argument('--params-file', nargs='*', default=[], help='parameter files; later files take precedence')
    parser.add_argument('--sample-time', type=float, default=1e-4, help='T [s]')
    parser.add_argument('--seconds', type=float, default=12.0, help='duration of the runs [s]')
    return parser


@command('instruments')
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; exit code 0 done, 2 invalid arguments or parameters."""
    options = command_line().parse_args(arguments)
    _print_tables(options)
    return 0


def _print_tables(options: argparse.Namespace) -> None:
    TimerParameters(sample_time=options.sample_time, duration=0.0)
    if not options.seconds > TRANSIENT:
        raise ArgumentError(
            f'--seconds {options.seconds:g} is rejected: expected more than the transient of {TRANSIENT:g} s'
        )
    sections = read_parameter_files(options.params_file)
    print(f'2 um sine, {options.seconds:g} s, after {TRANSIENT:g} s: rms / max error of the head [nm]\n')
    _print_head('effect')
    for name, values in LDV_EFFECTS:
        cells = errors(with_values(sections, ldv_sensor=values), options.sample_time, options.seconds)
        _print_row([name, *cells])
    for name, values in DSP_EFFECTS:
        _print_row([name, *errors(_with_controllers(sections, values), options.sample_time, options.seconds)])

    print('\nVelocity from differences of displacement, after a 2 kHz low-pass filter\n')
    _print_head('noise, reference')
    for noise, filter_reference in DIFFERENCES:
        values = {'velocity_source': 'difference', 'filter_reference': filter_reference}
        own = with_values(
            sections,
            ldv_sensor={'noise': noise},
            adaptive_nn_controller={**values, 'velocity_bandwidth': 2000.0},
            pid_controller={**values, 'derivative_bandwidth': 2000.0},
        )
        name = f'{"with" if noise else "without"} noise, reference {"filtered" if filter_reference else "not filtered"}'
        _print_row([name, *errors(own, options.sample_time, options.seconds)])


if __name__ == '__main__':
    sys.exit(main())
