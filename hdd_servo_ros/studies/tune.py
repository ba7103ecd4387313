"""
Tune both controllers for a drive under the same constraint, and print their sections of a parameter file.

    ros2 run hdd_servo_ros tune [--params-file FILE ...] [--overshoot 20|none] [--seconds 60]
    ros2 run hdd_servo_ros tune --params-file params/simulation_study.yaml --same-peak

Constraint (rule) for both controllers: the sampled loop has a peak sensitivity Ms <= 2, both in presliding, where
friction is a spring, and in sliding, where only viscous friction remains. The loop includes the hold, the resonances,
the amplifier, coil and back-EMF of the driver, the filters, and the computation delay ``dsp.computation_delay`` in the
section of the controller. It includes no additional delay margin.

Adaptive NN controller. Once its estimates follow ``|r|``, the law acts as the linear gain g = k + 1/sigma_phi +
max(S'S)/sigma_w on r. This sum, not k alone, is the loop gain. lambda and lambda_i are given. g is the largest value
that the rule allows, and is divided 80 : 10 : 10. If no g satisfies the rule with the given lambda, lambda is reduced
to the largest value for which one does. The shares of phi_hat and the network are small because these terms multiply
sgn r and chatter in the noise. Their leakage rate is 5 1/s.

With desired compensation, g is divided 95 : 2.5 : 2.5, and the estimates do not affect the frozen loop. Each adaptation
law is normalized by the peak of its regressor, and on a sine far above its scale s the estimate converges at
k_i s^2/(2 g). This rate is 100 1/s for sigma_hat, m_hat and spring_hat, 300 1/s for hysteresis_hat and 200 1/s for
relaxation_hat. The last two are faster because only they can remove the third harmonic, the smallest part of the error.
Without desired compensation, sigma_hat and m_hat converge at 6 1/s on the design reference, a 2 µm sine at 100 Hz
(k_sigma <v^2>/g and k_m <a^2>/g, with means over a period). They settle within a second, and are slow enough for the
loop at 500 Hz, where m_hat converges 625 times as fast. There, one sample of delay adds 18 degrees of phase lag. m_hat
then tolerates at most 3.6 1/s, and the rule sets 2 1/s. The leakage rate of all these estimates is 0.03 1/s.

PID controller. The gains k_p, k_i, k_d and the corner frequency of the derivative filter have the least squared error
on 2 µm sines at 100 and 200 Hz, with vibrometer noise, among all that satisfy Ms <= 2 and the limit of the overshoot.
The overshoot is the larger one of single steps of 0.5 and 5 µm from rest, in the true head position of the simulated
loop; ``--overshoot`` sets its limit, 20 % by default, or ``none``. k_p is always the largest value with Ms <= 2: a
larger gain at low frequency does not increase the error on the sines. As a function of k_i, the error has a maximum
where integral and derivative cancel in ``|C|^2 = k_p^2 + (k_d w - k_i/w)^2``. Therefore differential evolution searches
the ranges below and above this maximum separately, with an estimate of the error that needs no run
(:mod:`~hdd_servo_ros.analysis.sine_error`). A Nelder-Mead search on simulated sines starts from the better of the two
results. With a limit of the overshoot, a further search over all four gains finds the largest k_i that increases the
least squared error by at most 5 %: the sines need no integral action, but steps and slow references do. All gains are
rounded to three digits. The search is deterministic.

``--same-peak`` tunes only the PID controller, for a study with a given adaptive NN controller (section 4.4): the gains
have the least squared error over the last half of 20 s of the reference in the file, with a peak control not above that
of the adaptive NN controller. This search is also global: differential evolution with short runs, then Nelder-Mead.
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
        description='Tune the adaptive NN and the PID controller for a drive under the same constraint, a peak '
        f'sensitivity Ms <= {MAX_SENSITIVITY:g}: the largest effective gain of the adaptive NN controller, and the '
        'least error of the PID controller on sines with limited overshoot; print their sections of a parameter file, '
        'and their errors.',
        epilog='Exit code: 0 done, 2 invalid arguments or parameters.',
    )
    parser.add_argument(
        '--params-file',
        nargs='*',
        default=[],
        help='parameter files of the drive and the vibrometer; later files take precedence',
    )
    parser.add_argument('--sample-time', type=float, default=1e-4, help='T [s]')
    parser.add_argument('--seconds', type=float, default=60.0, help='duration of the runs in the table [s]')
    parser.add_argument(
        '--overshoot',
        default=f'{OVERSHOOT:g}',
        metavar='PERCENT',
        help='limit of the overshoot of steps with the PID controller [%%], or none; default %(default)s',
    )
    parser.add_argument(
        '--same-peak',
        action='store_true',
        help='tune only the PID controller: least error with a peak control of at most that of the adaptive NN '
        'controller in the parameter files, without a limit of Ms or of the overshoot',
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Tune, and print parameters and errors; exit code 0 done, 2 invalid arguments or parameters, 130 interrupted."""
    options = command_line().parse_args(arguments)
    return exit_code('tune', lambda: _tune(options), kept='no results are kept')


def _overshoot(text: str) -> float:
    """Return the limit of the overshoot [%]; infinity for no limit."""
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
    """Print the progress to stderr, separate from the result."""
    print(f'PID: {line}', file=sys.stderr, flush=True)


def _tune(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    TimerParameters(sample_time=options.sample_time, duration=0.0)
    if not options.seconds > TRANSIENT:
        raise ArgumentError(
            f'--seconds {options.seconds:g} is rejected: expected more than the transient of {TRANSIENT:g} s'
        )
    overshoot = _overshoot(options.overshoot)
    sections = read_parameter_files(options.params_file)
    sensor = sections.get('rig', {}).get('sensor', 'ldv')
    if sensor != 'ldv':
        raise ParameterError('rig:sensor', sensor, 'ldv, because the rule uses the velocity output of the vibrometer')
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
        # A YAML comment, because the output is a parameter file.
        print(
            f'# error_filter_lambda reduced from {base.error_filter_lambda:g} to {error_filter_lambda:g} 1/s, the '
            f'largest value for which a gain with Ms <= {MAX_SENSITIVITY:g} exists on this drive'
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
        print('\n! does not track, by the criteria of the reports: the errors of these runs are not meaningful')
    return 0


if __name__ == '__main__':
    sys.exit(main())
