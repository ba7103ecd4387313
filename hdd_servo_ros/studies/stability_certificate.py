"""
Stability certificate of theorem 4.1 for a recorded run of the adaptive NN controller.

    ros2 run hdd_servo_ros stability_certificate RUN

The command prints V(0), c1, c2, the bounds and the smallest margins to them for two choices of the ideal values (see
``stability/ideal_values.py``), lists which conditions of the theorem the run satisfies, and draws V, ``|r|`` and
``|e|`` with their bounds to ``certificate.png`` in the run directory.
"""

import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.graph.block_parameters import block_parameters, dsp_parameters, input_parameters, sensor_scales
from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import UNREADABLE, command, reading
from hdd_servo_ros.messages.topics import DISTURBANCE, PARAMETER_EVENTS
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.parameters import with_tuples
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.stability.certificate import Certificate, Condition, certify, conditions

CONTROLLER, DRIVE, SENSOR = 'adaptive_nn_controller', 'vcm_plant', 'ldv_sensor'
_POINTS = 4000


class CertificateError(ValueError):
    """The theorem does not apply to the run; the message states the reason."""

    exit_code = UNREADABLE


@dataclasses.dataclass(frozen=True)
class Report:
    """Certificates, conditions and units of a run."""

    certificates: tuple[Certificate, ...]
    conditions: tuple[Condition, ...]
    units: Units


def certificate_of_run(directory: Path, extra_disturbance: float | None = None) -> Report:
    """
    Return the stability certificate of a run directory.

    Parameters
    ----------
    directory
        The run directory.
    extra_disturbance
        Bound of the disturbance [V]; required if a node published one during the run.

    Raises
    ------
    CertificateError, ParameterError, WeightReplayError
        If the theorem does not apply to this run, or the controller states cannot be recovered.
    FileNotFoundError, ValueError
        If the directory has no readable run.
    """
    run = read_run_yaml(directory)
    nodes = {name.rsplit('/', 1)[-1]: node for name, node in run['nodes'].items()}
    for name in (CONTROLLER, DRIVE, SENSOR):
        if name not in nodes:
            raise CertificateError(f'{directory}: the run has no {name}, only {", ".join(nodes)}')
    changed = _changed_nodes(directory) & {CONTROLLER, DRIVE, SENSOR}
    if changed:
        raise CertificateError(
            f'{directory}: parameters of {", ".join(sorted(changed))} changed during the run; the theorem applies only '
            'to constant parameters'
        )
    if DISTURBANCE.name in {**run['topics'], **run.get('topics_left_out', {})} and extra_disturbance is None:
        raise CertificateError(
            f'{directory}: a node published {DISTURBANCE.name}; pass the bound of the disturbance with --disturbance'
        )
    values = with_tuples(nodes[CONTROLLER]['parameters'])
    controller = block_parameters(CONTROLLER, values)
    dsp = dsp_parameters(CONTROLLER, values)
    plant = block_parameters(DRIVE, with_tuples(nodes[DRIVE]['parameters']))
    sensor = block_parameters(SENSOR, with_tuples(nodes[SENSOR]['parameters']))
    scales = sensor_scales(input_parameters(CONTROLLER, values), sensor)
    signals = RecordedRun.open(directory)
    sample_time = float(run['sample_time'])
    certificates = certify(signals, sample_time, plant, controller, dsp, scales, extra_disturbance or 0.0)
    kept = conditions(signals, sample_time, plant, controller, dsp, certificates)
    return Report(certificates, kept, signals.units)


def _changed_nodes(directory: Path) -> set[str]:
    """Return the nodes whose parameters changed during the run."""
    payloads = [
        payload
        for topic, (_, messages) in RecordedRun.open(directory).messages_by_topic().items()
        if topic == PARAMETER_EVENTS
        for payload in messages
    ]
    if not payloads:
        return set()
    store = get_typestore(Stores.ROS2_JAZZY)
    events: list[Any] = [store.deserialize_cdr(payload, 'rcl_interfaces/msg/ParameterEvent') for payload in payloads]
    return {event.node.rsplit('/', 1)[-1] for event in events}


TITLES = {
    'theorem': 'with the ideal values of (4.12) and (4.13), over the region that the run covered',
    'run': 'with the friction of this run (not valid for other runs)',
}


def table(report: Report) -> str:
    """Return the report as lines of text with a table."""
    in_units, lines = report.units.of, []
    for certificate in report.certificates:
        bounds, ideal = certificate.bounds, certificate.ideal
        smallest = min(certificate.rates, key=certificate.rates.__getitem__)
        weights = float(np.linalg.norm(ideal.weights))
        lines += [
            f'{certificate.kind}: {TITLES[certificate.kind]}',
            f'  ideal values  sigma {ideal.sigma:.4g}, m {ideal.mass:.4g}, phi {ideal.phi:.4g}, |W*| {weights:.4g}',
            f'  V(0) {bounds.initial:.4g}, c1 {bounds.c1:.4g} 1/s (of {smallest}), c2 {bounds.c2:.4g}, '
            f'c2/c1 {bounds.ultimate:.4g}',
            f'  {"":29}{"closest":>12}{"bound":>12}{"margin":>12}{"bound/value":>12}{"tick":>9}{"violations":>12}',
        ]
        for each in certificate.checks:
            name = f'{each.name} [{in_units(each.unit)}]' if each.unit else each.name
            lines.append(
                f'  {name:<29}{each.value:>12.4g}{each.limit:>12.4g}{each.margin:>12.4g}{each.tightness:>12.4g}'
                f'{each.tick:>9}{each.violations:>12}'
            )
            if each.first_violation is not None:
                tick, value, limit = each.first_violation
                lines.append(f'    first violated at tick {tick}: {value:.6g} above {limit:.6g}')
        late = [('|r|', in_units('um/s'), certificate.late(certificate.r), bounds.r_of(bounds.ultimate))]
        if bounds.error_filter.is_stable:
            late.append(('|e|', in_units('um'), certificate.late(certificate.e), bounds.e_of(bounds.ultimate)))
        for name, unit, value, limit in late:
            lines.append(
                f'  {name} in the second half: {value:.4g} {unit}; ultimate bound (ii): {limit:.4g} {unit}, '
                f'bound/value {limit / value if value > 0.0 else np.inf:.4g}'
            )
        lines.append('')
    lines.append('conditions of the theorem in this run:')
    width = max(len(each.name) for each in report.conditions)
    lines += [
        f'  {each.name:<{width}}  {"met" if each.holds else "NOT MET":<7}  {each.detail}' for each in report.conditions
    ]
    return '\n'.join(lines)


def draw(report: Report, path: Path) -> None:
    """Draw V, ``|r|`` and ``|e|`` with their bounds over time into a PNG file."""
    # Not pyplot: writing a file needs no display.
    figure = Figure(figsize=(11, 9), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, sharex=True)
    length = report.units.length
    for index, certificate in enumerate(report.certificates):
        bounds, time = certificate.bounds, certificate.time
        every = slice(None, None, max(1, len(time) // _POINTS))
        drawn = (
            (certificate.value, bounds.level(time), f'V ({certificate.kind})'),
            (np.abs(certificate.r), bounds.r_over(time), '|r|'),
            (np.abs(certificate.e), bounds.e_over(time, float(certificate.e[0]), certificate.first_integral), '|e|'),
        )
        for axis, (values, limits, label) in zip(axes, drawn, strict=True):
            if axis is axes[0] or index == 0:
                axis.semilogy(time[every], values[every], color=f'C{index}', linewidth=0.9, label=label)
            if np.isfinite(limits).all():
                label = f'bound ({certificate.kind})'
                axis.semilogy(time[every], limits[every], '--', color=f'C{index}', label=label)
    first = report.certificates[0]
    for axis, values in zip(axes[1:], (first.r, first.e), strict=True):
        # Samples near a zero crossing would extend the logarithmic axis arbitrarily.
        largest = float(np.abs(values).max())
        axis.set_ylim(bottom=1e-5 * largest if largest > 0.0 else None)
    for axis, name in zip(axes, ('V (4.22)', f'|r| [{length}/s]', f'|e| [{length}]'), strict=True):
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
        axis.legend(loc='center right', fontsize=8)
    axes[-1].set_xlabel('time [s]')
    figure.suptitle('Stability certificate, theorem 4.1')
    figure.savefig(path, dpi=110)


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='stability_certificate',
        description='Print and draw the stability certificate of theorem 4.1 for a recorded run of the adaptive NN '
        'controller; the figure is certificate.png in the run directory.',
        epilog='Exit code: 0 done (also if a bound is violated), 1 the figure cannot be written, 2 invalid '
        'arguments, 3 the run has no certificate or cannot be read.',
    )
    parser.add_argument('run', type=Path, help='run directory')
    parser.add_argument('--disturbance', type=float, help='bound on the magnitude of the force on /disturbance [V]')
    return parser


@command('stability_certificate', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print and draw the certificate of a run; see the help text for the exit codes."""
    parser = command_line()
    options = parser.parse_args(arguments)
    if options.disturbance is not None and not 0.0 <= options.disturbance < math.inf:
        parser.error(f'--disturbance {options.disturbance:g} is rejected: expected a finite number >= 0 [V]')
    with reading(options.run):
        report = certificate_of_run(options.run, options.disturbance)
    print(table(report))
    figure = options.run / 'certificate.png'
    draw(report, figure)
    print(f'\nfigure  {figure}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
