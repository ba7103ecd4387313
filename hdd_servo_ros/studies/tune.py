"""
Tune both controllers for a drive by one rule, and print what belongs into the parameter file.

    ros2 run hdd_servo_ros tune [--params-file FILE ...] [--overshoot 20|none] [--seconds 60]
    ros2 run hdd_servo_ros tune --params-file params/simulation_study.yaml --same-peak

The rule for both: peak sensitivity Ms <= 2 of the sampled loop, in presliding, where the friction is a spring, and in
sliding, where its viscous part alone is left. The loop has the hold, the resonances, the driver's amplifier, coil and
back-EMF, the filters and the computation delay ``dsp.computation_delay`` of the controller's section, and no spare
delay.

Adaptive NN controller. Once its estimates follow |r|, the law acts as the linear gain g = k + 1/sigma_phi +
max(S'S)/sigma_w on r: this sum, not k alone, is the gain of the loop. With lambda and lambda_i given, g gets the
largest value that the rule allows, and is divided 80 : 10 : 10. Where no g does with the given lambda, lambda is
reduced to the largest with which one does. The network and phi_hat get the small shares because they multiply sgn r,
which chatters in the noise. Their leakage rate is 5 1/s.

With desired compensation g is divided 95 : 2.5 : 2.5, and the estimates are not in the frozen loop. Each law is
normalized by the peak of its regressor, and on a sine far above its scale s the estimate converges at k_i s^2/(2 g):
100 1/s for sigma_hat, m_hat and spring_hat, 300 for hysteresis_hat and 200 for relaxation_hat, since the third
harmonic, which only they can remove, is the smallest part of the error.
Without it, sigma_hat and m_hat converge at 6 1/s on the design reference, a 2 um sine at 100 Hz (k_sigma <v^2>/g and
k_m <a^2>/g, with the means over a period), fast enough to settle within a second, slow enough not to outrun the loop at
500 Hz, where m_hat converges 625 times as fast. A sample of delay turns the loop by another 18 degrees there; m_hat
then tolerates at most 3.6 1/s, and gets 2 1/s. The leakage rate of all of them is 0.03 1/s.

PID controller. Of all k_p, k_i, k_d and corner frequencies of the derivative's filter that keep Ms <= 2 and the limit
of the overshoot, it gets those with the least squared error on 2 um sines at 100 and 200 Hz, with the vibrometer's
noise. The overshoot is that of the head's true position in the simulated loop, on lone steps of 0.5 and 5 um from rest,
the larger of the two; ``--overshoot`` gives its limit, 20 % unless stated otherwise, or ``none``. k_p is always the
largest with Ms <= 2: a larger gain at low frequency costs nothing on the sines. Over k_i the error has a maximum, where
integral and derivative cancel in |C|^2 = k_p^2 + (k_d w - k_i/w)^2. So differential evolution searches the range below
and the range above it, by an estimate of the error that needs no run (:mod:`~hdd_servo_ros.analysis.sine_error`); a
Nelder-Mead search on simulated sines begins at the better of the two. Where steps count, that is with a limit of the
overshoot, the largest k_i follows that costs at most 5 % of the least squared error, again of all four gains: the sines
need no integral, steps and slow references do. All gains are rounded to three digits. The search is deterministic.

With ``--same-peak`` the PID controller alone is tuned, for a study whose adaptive NN controller is given (section 4.4):
least squared error over the last half of 20 s of the file's reference, with no more peak control than the adaptive NN
controller reaches on it. That search is global too: differential evolution on short runs, then Nelder-Mead.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence

from hdd_servo_ros.analysis.linear_laws import pid_law
from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LinearController, LoopMargins
from hdd_servo_ros.campaign.command import exit_code
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, read_parameter_files
from hdd_servo_ros.parameters.run_parameters import TimerParameters
from hdd_servo_ros.studies.adaptive_nn_rule import tune_adaptive_nn
from hdd_servo_ros.studies.pid_same_peak import tune_pid_same_peak
from hdd_servo_ros.studies.pid_search import OVERSHOOT, computation_delay, tune_pid
from hdd_servo_ros.studies.tuned_laws import TunedLaw, runs_on_sines
from hdd_servo_ros.studies.tuning_runs import TRANSIENT, Steps


def _print_section(node: str, gains: Mapping[str, object]) -> None:
    print(f'/**/{node}:\n  ros__parameters:')
    for name, value in gains.items():
        print(f'    {name}: {value}')


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='tune',
        description='Tune the adaptive NN and the PID controller for a drive by one rule, the largest gains with a '
        f'peak sensitivity Ms <= {MAX_SENSITIVITY:g}; print their sections of a parameter file, and what they do.',
        epilog='Exit code: 0 done, 2 invalid arguments or parameters.',
    )
    parser.add_argument(
        '--params-file', nargs='*', default=[], help='parameter files of the drive and the vibrometer, later ones win'
    )
    parser.add_argument('--sample-time', type=float, default=1e-4, help='T [s]')
    parser.add_argument('--seconds', type=float, default=60.0, help='length of the runs in the table [s]')
    parser.add_argument(
        '--overshoot',
        default=f'{OVERSHOOT:g}',
        metavar='PERCENT',
        help="limit of the PID controller's overshoot on steps, or none; default %(default)s",
    )
    parser.add_argument(
        '--same-peak', action='store_true', help='tune PID alone, under the peak control of the adaptive NN controller'
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Tune, print the parameters and what they do; 0 done, 2 wrong arguments or parameters, 130 interrupted."""
    options = command_line().parse_args(arguments)
    return exit_code('tune', lambda: _tune(options), kept='nothing is kept')


def _overshoot(text: str) -> float:
    """Return the limit of the overshoot [%]; infinity for none."""
    if text == 'none':
        return math.inf
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not 0.0 < limit < math.inf:
        raise ArgumentError(f'--overshoot {text} is rejected: expected a number above 0 [%], or none')
    return limit


def _progress(line: str) -> None:
    """Print how the search goes on, apart from the result."""
    print(f'PID: {line}', file=sys.stderr, flush=True)


def _tune(options: argparse.Namespace) -> int:
    """Do what the command line asks for."""
    TimerParameters(sample_time=options.sample_time, duration=0.0)
    if not options.seconds > TRANSIENT:
        raise ArgumentError(f'--seconds {options.seconds:g} is no more than the {TRANSIENT:g} s that do not count')
    overshoot = _overshoot(options.overshoot)
    sections = read_parameter_files(options.params_file)
    sensor = sections.get('rig', {}).get('sensor', 'ldv')
    if sensor != 'ldv':
        raise ParameterError('rig:sensor', sensor, 'ldv: the rule tunes for the velocity output of the vibrometer')
    if options.same_peak:
        _print_section('pid_controller', tune_pid_same_peak(sections, options.sample_time, _progress))
        return 0
    plant: PlantParameters = block_parameters('vcm_plant', sections.get('vcm_plant', {}))
    base: AdaptiveNnParameters = block_parameters('adaptive_nn_controller', sections.get('adaptive_nn_controller', {}))
    delays = {node: computation_delay(sections, node) for node in ('adaptive_nn_controller', 'pid_controller')}
    nn = tune_adaptive_nn(plant, options.sample_time, base, delays['adaptive_nn_controller'])
    pid = tune_pid(plant, options.sample_time, sections, overshoot, _progress)
    error_filter_lambda = float(str(nn['error_filter_lambda']))
    if error_filter_lambda < base.error_filter_lambda:
        # A comment, for what is printed is a parameter file.
        print(
            f'# error_filter_lambda reduced from {base.error_filter_lambda:g} to {error_filter_lambda:g} 1/s, the '
            f'largest with which some gain gives Ms <= {MAX_SENSITIVITY:g} on this drive'
        )
    _print_section('adaptive_nn_controller', nn)
    _print_section('pid_controller', pid)
    margins = LoopMargins(plant, options.sample_time)
    same = {
        'proportional_gain': float(str(nn['feedback_gain'])) * error_filter_lambda,
        'derivative_gain': nn['feedback_gain'],
        'integral_gain': 0.0,
        'derivative_bandwidth': 0.0,
    }
    g = float(str(nn['safe_gain']))
    integral = float(str(nn.get('integral_gain', base.integral_gain)))
    law = LinearController.on_r(g, error_filter_lambda, integral, delays['adaptive_nn_controller'])
    print(f'\nMs of -g r:  {margins.peak_sensitivity(law):.3f}')
    fair = pid_law(block_parameters('pid_controller', pid), delays['pid_controller'])
    print(f'Ms of PID:   {margins.peak_sensitivity(fair):.3f}')
    print(f'Overshoot of PID on steps: {Steps(sections, options.sample_time).overshoot(pid):.1f} %')
    print(f'\n2 um sine, {options.seconds:g} s, after {TRANSIENT:g} s:   rms / max error [nm], peak u [V]')
    laws = (
        TunedLaw('adaptive NN', 'adaptive_nn', nn),
        TunedLaw('PID', 'pid', pid),
        TunedLaw('PID with k_p = k lambda, k_d = k', 'pid', same),
    )
    marks = []
    for run in runs_on_sines(laws, sections, options.sample_time, options.seconds):
        marks.append(run.mark)
        errors = f'{run.rms_error:8.2f} / {run.max_error:8.2f}'
        print(f'{run.law:34s} {run.frequency:5g} Hz   {errors}   {run.peak_control:.3f}   {run.mark}'.rstrip())
    if any(marks):
        print('\n! does not track, by the criteria of the reports: the errors are not those of a loop that works')
    return 0


if __name__ == '__main__':
    sys.exit(main())
