"""
Certificate of theorem 4.1 for one run of the loop: bounds, how near the run came to them, and the theorem's conditions.

V needs all weights at every tick: the controller is replayed for them
(see :mod:`hdd_servo_ros.stability.weight_replay`).
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.control.input_shaping import SHAPING_STATE, fill_shaped
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.numerics.records import zeros
from hdd_servo_ros.stability.bounds import (
    Bounds,
    Check,
    check,
    convergence_rates,
    lyapunov,
    scalar_laws,
    theorem_bounds,
    weight_energy,
)
from hdd_servo_ros.stability.ideal_values import IdealValues, KnownPlant, NetworkAt, run_values, theorem_values
from hdd_servo_ros.stability.weight_replay import replay_weights

Array = NDArray[np.float64]

_SAME = 1e-9
_JUMP = 0.1
UNITS = {'sigma_hat': 'V s/um', 'm_hat': 'V s^2/um', 'phi_hat': 'V'}
FRICTION_CHECK = '|h - sigma v| + d*  (4.14)'
SAMPLE_CHECK = 'V after a sample  (4.29)'
ASSUMED = (FRICTION_CHECK, SAMPLE_CHECK)
"""What the theorem assumes or derives for continuous time; the other checks are its bounds."""


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
        ``theorem`` or ``run``; see :mod:`hdd_servo_ros.stability.ideal_values`.
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


def certify(
    signals: Signals,
    sample_time: float,
    plant: PlantParameters,
    controller: AdaptiveNnParameters,
    dsp: DspParameters,
    scales: SensorScales,
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
    plant, controller, dsp
        What was run.
    scales
        Scales by which the controller read the vibrometer.
    extra_disturbance
        Bound of a disturbance beside the drive's own [V].

    Raises
    ------
    ParameterError
        If the theorem does not cover this controller at all.
    WeightReplayError
        If the controller's states cannot be recovered.
    """
    mass = 1.0 / plant.rigid_gain
    x, v, friction = signals.head[:, :3].T
    columns = signals.estimates
    e = x - _shaped_reference(signals, controller, sample_time)
    r = v - signals.reference[:, 1] + controller.error_filter_lambda * e
    r = r + controller.integral_gain * columns['integral']
    seen = _network_inputs(signals, controller, scales)
    d = abs(plant.disturbance.amplitude) + extra_disturbance
    ideals = {'run': run_values(mass, controller, friction, v, seen, d)}
    if plant.friction.model == 'lugre' and controller.sigma.enabled:
        region = ((min(x.min(), 0.0), max(x.max(), 0.0)), (min(v.min(), 0.0), max(v.max(), 0.0)))
        ideals = {'theorem': theorem_values(known_plant(plant, d), controller, region), **ideals}
    energies = {kind: np.empty(len(x)) for kind in ideals}
    pieces = replay_weights(
        controller,
        dsp,
        plant.control_limit,
        sample_time,
        scales,
        signals.reference,
        signals.ldv,
        signals.control,
        signals['estimates'],
    )
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


def known_plant(plant: PlantParameters, disturbance_bound: float) -> KnownPlant:
    """Return what the theorem knows of a drive, with the bound of |d| [V]."""
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


def _shaped_reference(signals: Signals, controller: AdaptiveNnParameters, sample_time: float) -> Array:
    """Return x_d as the law takes it [um]: without the part of a jump that is still held back."""
    x_d: Array = signals.reference[:, 0].copy()
    dx_d: Array = signals.reference[:, 1].copy()
    shaping = controller.shaping
    fill_shaped(zeros(SHAPING_STATE), x_d, dx_d, shaping.share, shaping.ticks(sample_time))
    return x_d


def _network_inputs(
    signals: Signals, controller: AdaptiveNnParameters, scales: SensorScales
) -> tuple[Array, Array] | None:
    """Return the position [um] and velocity [um/s] that the network saw; None where its velocity is not recorded."""
    if controller.network.input == 'reference':
        return signals.reference[:, 0], signals.reference[:, 1]
    if controller.velocity_source != 'sensor':
        return None
    return signals.ldv[:, 0] * scales.displacement, signals.ldv[:, 1] * scales.velocity


def _checks(time: Array, value: Array, r: Array, e: Array, bounds: Bounds, sample_time: float) -> tuple[Check, ...]:
    """Compare V, r and e with their bounds."""
    decay = np.exp(-bounds.c1 * sample_time)
    magnitude, error = np.abs(r), np.abs(e)
    checks = [
        check(SAMPLE_CHECK, '', value[1:], decay * value[:-1] + (1.0 - decay) * bounds.ultimate, first_tick=1),
        check('V  (4.33)', '', value, bounds.level(time)),
        check('|r|  (i)', 'um/s', magnitude, bounds.r_of(bounds.uniform)),
        check('|r|  (ii), over time', 'um/s', magnitude, bounds.r_over(time)),
    ]
    if bounds.error_filter_lambda > 0.0:
        checks += [
            check('|e|  (i)', 'um', error, error[0] + bounds.e_of(bounds.uniform)),
            check('|e|  (ii), over time', 'um', error, bounds.e_over(time, float(e[0]))),
        ]
    return tuple(checks if len(value) > 1 else checks[1:])


def _estimate_checks(
    controller: AdaptiveNnParameters, ideal: IdealValues, bounds: Bounds, columns: Mapping[str, Array]
) -> list[Check]:
    """Compare the estimates with (4.38)."""
    checks = []
    for name, law, true in scalar_laws(controller, ideal):
        limit = abs(true) + (2.0 * bounds.uniform * law.gain) ** 0.5
        checks.append(check(f'|{name}|  (i)', UNITS[name], np.abs(columns[name]), limit))
    if controller.network.enabled:
        # 1/lambda_min(Gamma^-1) = max(Gamma)
        limit = float(np.linalg.norm(ideal.weights)) + (2.0 * bounds.uniform * max(controller.network.gain)) ** 0.5
        checks.append(check('|W_hat|  (i)', 'V', columns['W_norm'], limit))
    return checks


def conditions(
    signals: Signals,
    sample_time: float,
    plant: PlantParameters,
    controller: AdaptiveNnParameters,
    dsp: DspParameters,
    certificates: Sequence[Certificate],
) -> tuple[Condition, ...]:
    """Return what theorem 4.1 takes for granted, and whether the run keeps it."""
    columns = signals.estimates
    r = certificates[0].r
    off = float(np.abs(columns['r'] - r).max())
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
        *_output_conditions(signals, sample_time, plant, controller, dsp),
        Condition('the whole r in the laws', not clipped.any(), f'r was clipped at {int(clipped.sum())} ticks'),
        Condition('reference without jumps', smooth, detail),
    ]
    if controller.projection:
        found += [_projection(controller, certificate) for certificate in certificates]
    for certificate in certificates:
        if certificate.kind == 'theorem':
            velocity = certificate.bounds.r_of(certificate.bounds.uniform)
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


def _output_conditions(
    signals: Signals, sample_time: float, plant: PlantParameters, controller: AdaptiveNnParameters, dsp: DspParameters
) -> tuple[Condition, ...]:
    """Return what the theorem takes for granted of the way to the force: the law's u, whole, exact and at once."""
    # With a delay, u and u before the limit are still those of one command.
    u, unsaturated = signals.control[:, :2].T
    dac_limit = Dsp(dsp, sample_time).limit
    limits = {
        'control_limit': controller.control_limit,
        'dsp.dac_range': dac_limit,
        "the drive's control_limit": plant.control_limit,
    }
    smallest = min(limits, key=limits.__getitem__)
    limited = np.abs(unsaturated) > limits[smallest]
    quantisation, delay = f'dsp.dac_bits {dsp.dac_bits}', f'dsp.computation_delay {dsp.computation_delay}'
    if dsp.dac_bits > 0:
        rounded = float(np.abs(u - unsaturated)[~limited].max(initial=0.0))
        quantisation += f': u rounded by up to {rounded:.3g}, which the theorem does not cover'
    if dsp.computation_delay > 0:
        delay += f': u {dsp.computation_delay * sample_time:g} s late, which the theorem does not cover'
    return (
        Condition(
            'no saturation',
            not limited.any(),
            f'u was limited at {int(limited.sum())} ticks; {smallest} lets {limits[smallest]:.6g} out',
        ),
        Condition('no quantisation of u', dsp.dac_bits == 0, quantisation),
        Condition('no computation delay', dsp.computation_delay == 0, delay),
    )


def _smooth(signals: Signals, controller: AdaptiveNnParameters, sample_time: float) -> tuple[bool, str]:
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
