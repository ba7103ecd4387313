"""
The stability certificate of theorem 4.1 for a recorded run of the adaptive NN controller.

    python -m hdd_servo_ros.studies.certificate RUN

prints V(0), c1, c2, the bounds and how near the run came to them, for two choices of the ideal values (see
``control/ideal_values.py``), says which of the theorem's conditions the run keeps, and draws V and |r| with their
bounds into the run's folder as ``certificate.png``.
"""

import argparse
import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.certificate import (
    Bounds,
    Check,
    check,
    convergence_rates,
    lyapunov,
    scalar_laws,
    theorem_bounds,
    weight_energy,
)
from hdd_servo_ros.control.ideal_values import IdealValues, KnownPlant, NetworkAt, run_values, theorem_values
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.loop.experiment import Rows, block_parameters
from hdd_servo_ros.loop.replay import ReplayError, replay_weights
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.recording.bag_reader import Signals, read_messages, read_signals
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.recording.run_recorder import PARAMETER_EVENTS
from hdd_servo_ros.topics import DISTURBANCE

Array = NDArray[np.float64]

CONTROLLER, DRIVE, SENSOR = 'adaptive_nn_controller', 'vcm_plant', 'ldv_sensor'
_SAME = 1e-9
_JUMP = 0.1
UNITS = {'sigma_hat': 'V s/um', 'm_hat': 'V s^2/um', 'phi_hat': 'V'}
_POINTS = 4000


class CertificateError(ValueError):
    """A run of which no certificate can be given; says why."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """One condition of the theorem: whether the run keeps it, and by how much not."""

    name: str
    holds: bool
    detail: str


@dataclasses.dataclass(frozen=True)
class Certificate:
    """
    Theorem 4.1 for one choice of the ideal values.

    Attributes
    ----------
    kind
        ``theorem`` or ``run``; see :mod:`hdd_servo_ros.control.ideal_values`.
    ideal, rates, bounds
        The ideal values, the candidates of c1 [1/s], the bounds.
    time, value
        Time [s] and V at the ticks.
    r, e
        True filtered error [um/s] and error [um] at the ticks.
    checks
        Each signal against its bound.
    """

    kind: str
    ideal: IdealValues
    rates: dict[str, float]
    bounds: Bounds
    time: Array
    value: Array
    r: Array
    e: Array
    checks: tuple[Check, ...]

    @property
    def violations(self) -> int:
        """Number of violations of (i) and (ii), and of the bounds on V that they follow from."""
        return sum(each.violations for each in self.checks if each.name not in ASSUMED)

    def late(self, values: Array) -> float:
        """Return the largest magnitude in the second half of the run."""
        return float(np.abs(values[len(values) // 2 :]).max())


FRICTION_CHECK = '|h - sigma v| + d*  (4.14)'
SAMPLE_CHECK = 'V after a sample  (4.29)'
ASSUMED = (FRICTION_CHECK, SAMPLE_CHECK)
"""What the theorem assumes or derives for continuous time; the other checks are its bounds."""


def certify(
    signals: Signals | Rows,
    sample_time: float,
    plant: PlantParameters,
    controller: AdaptiveNnParameters,
    extra_disturbance: float = 0.0,
) -> tuple[Certificate, ...]:
    """
    Return the certificates of a run: for the thesis's own ideal values if the friction is LuGre, and for the run's.

    Parameters
    ----------
    signals
        The run from tick 0 on.
    sample_time
        T [s].
    plant, controller
        What was run.
    extra_disturbance
        Bound of a disturbance beside the drive's own [V].

    Raises
    ------
    ParameterError
        If the theorem does not cover this controller at all.
    ReplayError
        If the controller's states cannot be recovered.
    """
    mass = 1.0 / plant.rigid_gain
    x, v, friction = signals.head[:, :3].T
    columns = dict(zip(signals.estimate_names, signals.estimates.T, strict=True))
    e = x - signals.reference[:, 0]
    r = v - signals.reference[:, 1] + controller.error_filter_lambda * e
    r = r + controller.integral_gain * columns['integral']
    seen = _network_inputs(signals, controller)
    d = abs(plant.disturbance.amplitude) + extra_disturbance
    ideals = {'run': run_values(mass, controller, friction, v, seen, d)}
    if plant.friction.model == 'lugre' and controller.sigma.enabled:
        region = ((min(x.min(), 0.0), max(x.max(), 0.0)), (min(v.min(), 0.0), max(v.max(), 0.0)))
        ideals = {'theorem': theorem_values(_known(plant, d), controller, region), **ideals}
    energies = {kind: np.empty(len(x)) for kind in ideals}
    pieces = replay_weights(controller, sample_time, signals.reference, signals.ldv, signals.control, signals.estimates)
    for piece, weights, compensator in pieces:
        for kind, ideal in ideals.items():
            energies[kind][piece] = weight_energy(controller, ideal, weights, compensator)
    certificates = []
    for kind, ideal in ideals.items():
        value = lyapunov(controller, ideal, r, columns, energies[kind])
        bounds = theorem_bounds(controller, ideal, float(value[0]))
        bound = np.full(len(x), ideal.phi)
        if seen is not None:
            bound += NetworkAt(controller, seen).output(ideal.weights)
        checks = (
            check(FRICTION_CHECK, 'V', np.abs(friction - ideal.sigma * v) + d, bound),
            *_checks(signals.time, value, r, e, bounds, sample_time),
            *_estimate_checks(controller, ideal, bounds, columns),
        )
        rates = convergence_rates(controller, ideal)
        certificates.append(Certificate(kind, ideal, rates, bounds, signals.time, value, r, e, checks))
    return tuple(certificates)


def _known(plant: PlantParameters, disturbance_bound: float) -> KnownPlant:
    friction = plant.friction
    return KnownPlant(
        mass=1.0 / plant.rigid_gain,
        stiffness=friction.stiffness,
        bristle_damping=friction.bristle_damping,
        viscous_coefficient=friction.viscous_coefficient,
        coulomb_level=friction.coulomb_level,
        static_level=friction.static_level,
        stribeck_velocity=friction.stribeck_velocity,
        disturbance_bound=disturbance_bound,
    )


def _network_inputs(signals: Signals | Rows, controller: AdaptiveNnParameters) -> tuple[Array, Array] | None:
    """Return the position [um] and velocity [um/s] that the network saw; None where its velocity is not recorded."""
    if controller.network.input == 'reference':
        return signals.reference[:, 0], signals.reference[:, 1]
    if controller.velocity_source != 'sensor':
        return None
    return signals.ldv[:, 0] * controller.displacement_scale, signals.ldv[:, 1] * controller.velocity_scale


def _checks(time: Array, value: Array, r: Array, e: Array, bounds: Bounds, sample_time: float) -> tuple[Check, ...]:
    """Compare V, r and e with their bounds."""
    decay = np.exp(-bounds.c1 * sample_time)
    magnitude, error = np.abs(r), np.abs(e)
    checks = [
        check(SAMPLE_CHECK, '', value[1:], decay * value[:-1] + (1.0 - decay) * bounds.ultimate, first_tick=1),
        check('V  (4.33)', '', value, bounds.level(time)),
        check('|r|  (i)', 'um/s', magnitude, bounds.r_of(bounds.whole)),
        check('|r|  (ii), over time', 'um/s', magnitude, bounds.r_over(time)),
    ]
    if bounds.error_filter_lambda > 0.0:
        checks += [
            check('|e|  (i)', 'um', error, error[0] + bounds.e_of(bounds.whole)),
            check('|e|  (ii), over time', 'um', error, bounds.e_over(time, float(e[0]))),
        ]
    return tuple(checks if len(value) > 1 else checks[1:])


def _estimate_checks(
    controller: AdaptiveNnParameters, ideal: IdealValues, bounds: Bounds, columns: Mapping[str, Array]
) -> list[Check]:
    """Compare the estimates with (4.38)."""
    checks = []
    for name, law, true in scalar_laws(controller, ideal):
        limit = abs(true) + (2.0 * bounds.whole * law.gain) ** 0.5
        checks.append(check(f'|{name}|  (i)', UNITS[name], np.abs(columns[name]), limit))
    if controller.network.enabled:
        # 1/lambda_min(Gamma^-1) = max(Gamma)
        limit = float(np.linalg.norm(ideal.weights)) + (2.0 * bounds.whole * max(controller.network.gain)) ** 0.5
        checks.append(check('|W_hat|  (i)', 'V', columns['W_norm'], limit))
    return checks


def conditions(
    signals: Signals | Rows,
    sample_time: float,
    plant: PlantParameters,
    controller: AdaptiveNnParameters,
    certificates: Sequence[Certificate],
) -> tuple[Condition, ...]:
    """Return what theorem 4.1 takes for granted, and whether the run keeps it."""
    columns = dict(zip(signals.estimate_names, signals.estimates.T, strict=True))
    r = certificates[0].r
    off = float(np.abs(columns['r'] - r).max())
    limited = np.abs(signals.control[:, 1]) > min(controller.control_limit, plant.control_limit)
    clipped = np.abs(columns['r']) > controller.r_limit if controller.r_limit > 0.0 else np.zeros(len(r), dtype=bool)
    smooth, detail = _smooth(signals, controller, sample_time)
    resonances = plant.resonance.form != 'none'
    found = [
        Condition('continuous time', False, f'sampled and held, T = {sample_time:g} s: sgn r chatters at this rate'),
        Condition(
            'rigid body, force without lag',
            not resonances and plant.actuator.driver == 'reduced',
            f'resonances {plant.resonance.form}, driver {plant.actuator.driver}',
        ),
        Condition(
            'state read exactly',
            off <= _SAME * float(np.abs(r).max()),
            f"the controller's r is off by up to {off:.3g} of {float(np.abs(r).max()):.3g}",
        ),
        Condition('true sgn', controller.boundary_layer == 0.0, f'boundary layer {controller.boundary_layer:g}'),
        Condition('no saturation', not limited.any(), f'u was limited at {int(limited.sum())} ticks'),
        Condition('the whole r in the laws', not clipped.any(), f'r was clipped at {int(clipped.sum())} ticks'),
        Condition('reference without jumps', smooth, detail),
    ]
    if controller.projection:
        found += [_projection(controller, certificate) for certificate in certificates]
    for certificate in certificates:
        if certificate.kind == 'theorem':
            velocity = certificate.bounds.r_of(certificate.bounds.whole)
            reach = float(np.abs(signals.head[:, 1]).max())
            # |v| <= |dx_d| + lambda |e| + |r|, of which |r| alone decides.
            found.append(
                Condition(
                    'Omega of (i) inside the region where phi holds',
                    velocity <= reach,
                    f'(i) allows |r| up to {velocity:.3g}; phi was taken for |v| <= {reach:.3g}, where the run went',
                )
            )
    return tuple(found)


def _smooth(signals: Signals | Rows, controller: AdaptiveNnParameters, sample_time: float) -> tuple[bool, str]:
    """Return whether x_d and its derivative have no jumps: one makes r, and with it V, jump."""
    x, v, a = signals.reference.T
    gain = controller.error_filter_lambda
    jumps = np.abs(np.diff(v) - 0.5 * sample_time * (a[1:] + a[:-1]))
    jumps += gain * np.abs(np.diff(x) - 0.5 * sample_time * (v[1:] + v[:-1]))
    scale = float(np.abs(v).max() + gain * np.abs(x).max())
    count = int((jumps > _JUMP * scale).sum())
    return count == 0, f'{count} jumps'


def _projection(controller: AdaptiveNnParameters, certificate: Certificate) -> Condition:
    ideal = certificate.ideal
    inside = all(law.minimum <= true <= law.maximum for _, law, true in scalar_laws(controller, ideal))
    inside = inside and float(np.abs(ideal.weights).max()) <= controller.network.maximum
    return Condition(
        f'projection onto sets that hold the ideal values ({certificate.kind})', inside, 'their minimum and maximum'
    )


@dataclasses.dataclass(frozen=True)
class Report:
    """The certificates and conditions of a run, and its units."""

    certificates: tuple[Certificate, ...]
    conditions: tuple[Condition, ...]
    length_unit: str
    control_unit: str


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
    CertificateError, ParameterError, ReplayError
        If the theorem says nothing of this run, or its states cannot be recovered.
    FileNotFoundError, ValueError
        If there is no readable run.
    """
    run = read_run_yaml(directory)
    nodes = {name.rsplit('/', 1)[-1]: node for name, node in run['nodes'].items()}
    for name in (CONTROLLER, DRIVE):
        if name not in nodes:
            raise CertificateError(f'{directory}: no {name} took part, but {", ".join(nodes)}')
    changed = _changed_nodes(directory) & {CONTROLLER, DRIVE, SENSOR}
    if changed:
        raise CertificateError(
            f'{directory}: parameters of {", ".join(sorted(changed))} changed during the run; the theorem is about '
            'one set of constants'
        )
    outputs = {topic.rsplit('/', 1)[-1] for node in nodes.values() for topic in node['outputs']}
    if DISTURBANCE.name in outputs and extra_disturbance is None:
        raise CertificateError(f'{directory}: a node published {DISTURBANCE.name}: say its bound with --disturbance')
    controller = block_parameters(CONTROLLER, _tuples(nodes[CONTROLLER]['parameters']))
    plant = block_parameters(DRIVE, _tuples(nodes[DRIVE]['parameters']))
    signals = read_signals(directory)
    sample_time = float(run['sample_time'])
    certificates = certify(signals, sample_time, plant, controller, extra_disturbance or 0.0)
    kept = conditions(signals, sample_time, plant, controller, certificates)
    return Report(certificates, kept, str(run.get('length_unit', 'um')), str(run.get('control_unit', 'V')))


def _tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def _changed_nodes(directory: Path) -> set[str]:
    """Return the nodes whose parameters changed during the run."""
    payloads = [
        payload
        for topic, (_, messages) in read_messages(directory).items()
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

    def in_units(unit: str) -> str:
        return unit.replace('um', report.length_unit).replace('V', report.control_unit)

    lines = []
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
        if bounds.error_filter_lambda > 0.0:
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
    length = report.length_unit
    for place, certificate in enumerate(report.certificates):
        bounds, time = certificate.bounds, certificate.time
        every = slice(None, None, max(1, len(time) // _POINTS))
        drawn = (
            (certificate.value, bounds.level(time), f'V ({certificate.kind})'),
            (np.abs(certificate.r), bounds.r_over(time), '|r|'),
            (np.abs(certificate.e), bounds.e_over(time, float(certificate.e[0])), '|e|'),
        )
        for axis, (values, limits, label) in zip(axes, drawn, strict=True):
            if axis is axes[0] or place == 0:
                axis.semilogy(time[every], values[every], color=f'C{place}', linewidth=0.9, label=label)
            if np.isfinite(limits).all():
                label = f'bound ({certificate.kind})'
                axis.semilogy(time[every], limits[every], '--', color=f'C{place}', label=label)
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Print and draw the certificate of a run; exit code 2 if there is none to give."""
    parser = argparse.ArgumentParser(
        prog='python -m hdd_servo_ros.studies.certificate',
        description='The stability certificate of theorem 4.1 for a recorded run of the adaptive NN controller.',
    )
    parser.add_argument('run', type=Path, help='run folder')
    parser.add_argument('--disturbance', type=float, help='bound of a disturbance from a node of its own [V]')
    options = parser.parse_args(arguments)
    try:
        report = certificate_of_run(options.run, options.disturbance)
        print(table(report))
        picture = options.run / 'certificate.png'
        draw(report, picture)
    except (CertificateError, ParameterError, ReplayError, OSError, ValueError) as error:
        print(f'certificate: {error}', file=sys.stderr)
        return 2
    print(f'\npicture  {picture}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
