"""
The stability certificate of theorem 4.1 for a recorded run of the adaptive NN controller.

    ros2 run hdd_servo_ros stability_certificate RUN

prints V(0), c1, c2, the bounds and how near the run came to them, for two choices of the ideal values (see
``stability/ideal_values.py``), says which of the theorem's conditions the run keeps, and draws V, |r| and |e| with
their bounds into the run's folder as ``certificate.png``.
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
    """A run of which no certificate can be given; says why."""

    exit_code = UNREADABLE


@dataclasses.dataclass(frozen=True)
class Report:
    """The certificates and conditions of a run, and its units."""

    certificates: tuple[Certificate, ...]
    conditions: tuple[Condition, ...]
    units: Units


def certificate_of_run(directory: Path, extra_disturbance: float | None = None) -> Report:
    """
    Return the stability certificate of a run folder.

    Parameters
    ----------
    directory
        The run folder.
    extra_disturbance
        Bound of a disturbance from a node of its own [V]; needed if there was one.

    Raises
    ------
    CertificateError, ParameterError, WeightReplayError
        If the theorem says nothing of this run, or its states cannot be recovered.
    FileNotFoundError, ValueError
        If there is no readable run.
    """
    run = read_run_yaml(directory)
    nodes = {name.rsplit('/', 1)[-1]: node for name, node in run['nodes'].items()}
    for name in (CONTROLLER, DRIVE, SENSOR):
        if name not in nodes:
            raise CertificateError(f'{directory}: no {name} took part, but {", ".join(nodes)}')
    changed = _changed_nodes(directory) & {CONTROLLER, DRIVE, SENSOR}
    if changed:
        raise CertificateError(
            f'{directory}: parameters of {", ".join(sorted(changed))} changed during the run; the theorem is about '
            'one set of constants'
        )
    if DISTURBANCE.name in {**run['topics'], **run.get('topics_left_out', {})} and extra_disturbance is None:
        raise CertificateError(f'{directory}: a node published {DISTURBANCE.name}: say its bound with --disturbance')
    of_controller = with_tuples(nodes[CONTROLLER]['parameters'])
    controller = block_parameters(CONTROLLER, of_controller)
    dsp = dsp_parameters(CONTROLLER, of_controller)
    plant = block_parameters(DRIVE, with_tuples(nodes[DRIVE]['parameters']))
    sensor = block_parameters(SENSOR, with_tuples(nodes[SENSOR]['parameters']))
    scales = sensor_scales(input_parameters(CONTROLLER, of_controller), sensor)
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
    'theorem': "the thesis's split (4.12), (4.13), over the region where the run went",
    'run': 'for the friction that this run showed (says nothing of other runs)',
}


def table(report: Report) -> str:
    """Return the report as text."""
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
            f'  {"":29}{"nearest":>12}{"bound":>12}{"margin":>12}{"bound/value":>12}{"tick":>9}{"violations":>12}',
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
                f'  {name} in the last half: {value:.4g} {unit}; ultimate bound (ii): {limit:.4g} {unit}, '
                f'{limit / value if value > 0.0 else np.inf:.4g} times as large'
            )
        lines.append('')
    lines.append("the theorem's conditions in this run:")
    width = max(len(each.name) for each in report.conditions)
    lines += [
        f'  {each.name:<{width}}  {"kept" if each.holds else "NOT kept":<8}  {each.detail}'
        for each in report.conditions
    ]
    return '\n'.join(lines)


def draw(report: Report, path: Path) -> None:
    """Draw V, |r| and |e| with their bounds over time into a PNG file."""
    # Not pyplot: a picture into a file needs no display.
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
        # A zero crossing reaches down as far as a sample happens to come near it.
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
        'controller; the picture is certificate.png in the run folder.',
        epilog='Exit code: 0 done (also where a bound is violated), 1 the picture cannot be written, 2 wrong '
        'arguments, 3 the run has no certificate or cannot be read.',
    )
    parser.add_argument('run', type=Path, help='run folder')
    parser.add_argument('--disturbance', type=float, help='bound of a disturbance from a node of its own [V]')
    return parser


@command('stability_certificate', UNREADABLE)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print and draw the certificate of a run; exit code 2 if there is none to give."""
    parser = command_line()
    options = parser.parse_args(arguments)
    if options.disturbance is not None and not 0.0 <= options.disturbance < math.inf:
        parser.error(f'--disturbance {options.disturbance:g} is no bound: a finite number at least 0 [V]')
    with reading(options.run):
        report = certificate_of_run(options.run, options.disturbance)
    print(table(report))
    picture = options.run / 'certificate.png'
    draw(report, picture)
    print(f'\npicture  {picture}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
