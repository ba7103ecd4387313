"""
Certificate of theorem 4.1 for one run: bounds, how close the run came to them, and the conditions of the theorem.

V needs all weights at every tick, so the controller is replayed (see :mod:`hdd_servo_ros.stability.weight_replay`).
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
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.numerics.records import zeros
from hdd_servo_ros.stability.bounds import (
    Bounds,
    Check,
    check,
    convergence_rates,
    lyapunov,
    projection_allows,
    scalar_laws,
    theorem_bounds,
    weight_energy,
)
from hdd_servo_ros.stability.coverage import EFFECTS, Loop
from hdd_servo_ros.stability.ideal_values import IdealValues, KnownPlant, NetworkAt, Region, run_values, theorem_values
from hdd_servo_ros.stability.weight_replay import replay_weights

Array = NDArray[np.float64]

_SAME = 1e-9
_JUMP = 0.1
UNITS = {'sigma_hat': 'V s/um', 'm_hat': 'V s^2/um', 'phi_hat': 'V'}
FRICTION_CHECK = '|h - sigma v| + d*  (4.14)'
SAMPLE_CHECK = 'V after a sample  (4.29)'
ASSUMED = (FRICTION_CHECK, SAMPLE_CHECK)
"""Checks of assumptions or intermediate results in continuous time; the other checks are bounds of the theorem."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """One condition of the theorem: whether the run satisfies it, and the size of the deviation."""

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
        The ideal values, the candidates for c1 [1/s], the bounds.
    time, value
        Time [s] and V at the ticks.
    r, e
        True filtered error [um/s] and error [um] at the ticks.
    first_integral
        Integral of e in r of the first tick [um s].
    checks
        Comparisons of the signals with their bounds.
    """

    kind: str
    ideal: IdealValues
    rates: dict[str, float]
    bounds: Bounds
    time: Array
    value: Array
    r: Array
    e: Array
    first_integral: float
    checks: tuple[Check, ...]

    @property
    def violations(self) -> int:
        """Number of violations of (i), (ii) and the bounds on V from which they follow."""
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
    Return the certificates of a run: for the thesis's ideal values if the friction is LuGre, and for the run's own.

    Parameters
    ----------
    signals
        Signals of the run from tick 0 on.
    sample_time
        T [s].
    plant, controller, dsp
        Parameters of the run.
    scales
        Scales by which the controller read the vibrometer.
    extra_disturbance
        Bound on a disturbance in addition to the drive's own [V].

    Raises
    ------
    ParameterError
        If the theorem does not cover this controller.
    WeightReplayError
        If the controller's states cannot be recovered.
    """
    mass = 1.0 / plant.rigid_gain
    x, v, friction = signals.head[:, :3].T
    columns = signals.estimates
    e = x - _shaped_reference(signals, controller, sample_time)
    r = v - signals.reference[:, 1] + controller.error_filter_lambda * e
    r = r + controller.integral_gain * columns['integral']
    first_integral = float(columns['integral'][0])
    seen = _network_inputs(signals, controller, scales, sample_time)
    d = abs(plant.disturbance.amplitude) + extra_disturbance
    ideals = {'run': run_values(mass, controller, friction, v, seen, d)}
    if plant.friction.model == 'lugre' and controller.sigma.enabled:
        ideals = {'theorem': theorem_values(known_plant(plant, d), controller, _region(signals)), **ideals}
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
            *_checks(signals.time, value, r, e, first_integral, bounds, sample_time),
            *_estimate_checks(controller, ideal, bounds, columns),
        )
        rates = convergence_rates(controller, ideal)
        certificates.append(Certificate(kind, ideal, rates, bounds, signals.time, value, r, e, first_integral, checks))
    return tuple(certificates)


def known_plant(plant: PlantParameters, disturbance_bound: float) -> KnownPlant:
    """Return the theorem's model of a drive, with the bound on ``|d|`` [V]."""
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
    """Return x_d as the law receives it [um]: without the part of a step that is still delayed."""
    x_d: Array = signals.reference[:, 0].copy()
    dx_d: Array = signals.reference[:, 1].copy()
    shaping = controller.shaping
    fill_shaped(zeros(SHAPING_STATE), x_d, dx_d, shaping.share, shaping.ticks(sample_time))
    return x_d


def _network_inputs(
    signals: Signals, controller: AdaptiveNnParameters, scales: SensorScales, sample_time: float
) -> tuple[Array, Array] | None:
    """Return the network's input position [um] and velocity [um/s]; None if the velocity was not recorded."""
    if controller.network.input == 'reference':
        return _shaped_reference(signals, controller, sample_time), signals.reference[:, 1]
    if controller.velocity_source != 'sensor':
        return None
    return signals.ldv[:, 0] * scales.displacement, signals.ldv[:, 1] * scales.velocity


def _checks(
    time: Array, value: Array, r: Array, e: Array, first_integral: float, bounds: Bounds, sample_time: float
) -> tuple[Check, ...]:
    """Compare V, r and e with their bounds."""
    decay = np.exp(-bounds.c1 * sample_time)
    magnitude, error = np.abs(r), np.abs(e)
    checks = [
        check(SAMPLE_CHECK, '', value[1:], decay * value[:-1] + (1.0 - decay) * bounds.ultimate, first_tick=1),
        check('V  (4.33)', '', value, bounds.level(time)),
        check('|r|  (i)', 'um/s', magnitude, bounds.r_of(bounds.uniform)),
        check('|r|  (ii), over time', 'um/s', magnitude, bounds.r_over(time)),
    ]
    if bounds.error_filter.is_stable:
        first = float(e[0])
        checks += [
            check('|e|  (i)', 'um', error, bounds.omega(first, first_integral)[0]),
            check('|e|  (ii), over time', 'um', error, bounds.e_over(time, first, first_integral)),
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
    """Return the assumptions of theorem 4.1, and whether the run satisfies them."""
    measured = _measured(signals, sample_time, plant, controller, dsp, certificates)
    loop = Loop(controller, plant, dsp)
    found = []
    for effect in EFFECTS:
        if effect.name == 'projection':
            found += _projection(effect.condition, controller, certificates)
        elif effect.name in measured:
            found.append(Condition(effect.condition, *measured[effect.name]))
        else:
            is_in = effect.is_in(loop)
            found.append(Condition(effect.condition, not is_in, effect.statement if is_in else ''))
    region = _region(signals)
    x_d = _shaped_reference(signals, controller, sample_time)
    references = (x_d, signals.reference[:, 1])
    found += [_omega(each, references, region) for each in certificates if each.kind == 'theorem']
    return tuple(found)


def _region(signals: Signals) -> Region:
    """Return the ranges of position [um] and velocity [um/s] of the run, including rest at zero."""
    x, v = signals.head[:, :2].T
    return (min(x.min(), 0.0), max(x.max(), 0.0)), (min(v.min(), 0.0), max(v.max(), 0.0))


def _omega(certificate: Certificate, references: tuple[Array, Array], region: Region) -> Condition:
    """Compare the region that (i) allows for the state with the region for which phi was computed."""
    reach = certificate.bounds.omega(float(certificate.e[0]), certificate.first_integral)
    allowed = tuple((each.min() - far, each.max() + far) for each, far in zip(references, reach, strict=True))
    holds = all(low >= least and high <= most for (low, high), (least, most) in zip(allowed, region, strict=True))
    ranges = (
        f'{name} from {low:.3g} to {high:.3g}; the run covers {least:.3g} to {most:.3g}'
        for name, (low, high), (least, most) in zip(('x', 'v'), allowed, region, strict=True)
    )
    return Condition('Omega of (i) inside the region where phi holds', holds, f'(i) allows {"; ".join(ranges)}')


def _measured(
    signals: Signals,
    sample_time: float,
    plant: PlantParameters,
    controller: AdaptiveNnParameters,
    dsp: DspParameters,
    certificates: Sequence[Certificate],
) -> dict[str, tuple[bool, str]]:
    """Return, by name of the effect, whether the run satisfies its condition, and the size of the deviation."""
    columns = signals.estimates
    r = certificates[0].r
    off = float(np.abs(columns['r'] - r).max())
    clipped = np.abs(columns['r']) > controller.r_limit if controller.r_limit > 0.0 else np.zeros(len(r), dtype=bool)
    return {
        'sampling': (False, f'sampled and held, T = {sample_time:g} s: sgn r chatters at this rate'),
        'resonances': (plant.resonance.form == 'none', f'resonances {plant.resonance.form}'),
        'actuator.driver': (not plant.actuator.is_electrical, f'driver {plant.actuator.driver}'),
        'measurement': (
            off <= _SAME * float(np.abs(r).max()),
            f"the controller's r deviates by up to {off:.3g}, with r up to {float(np.abs(r).max()):.3g}",
        ),
        'boundary_layer': (controller.boundary_layer == 0.0, f'boundary layer {controller.boundary_layer:g}'),
        **_output_conditions(signals, sample_time, plant, controller, dsp),
        'r_limit': (not clipped.any(), f'r was limited at {int(clipped.sum())} ticks'),
        'reference steps': _smooth(signals, controller, sample_time),
        '/disturbance': (True, 'bound given' if DISTURBANCE.name in signals else 'not published'),
    }


def _output_conditions(
    signals: Signals, sample_time: float, plant: PlantParameters, controller: AdaptiveNnParameters, dsp: DspParameters
) -> dict[str, tuple[bool, str]]:
    """Check the theorem's assumptions on the path from u to the force: unlimited, exact and without delay."""
    # With a delay, u and u before the limit still belong to the same command.
    u, unsaturated = signals.control[:, :2].T
    dac_limit = Dsp(dsp, sample_time).limit
    limits = {
        'control_limit': controller.control_limit,
        'dsp.dac_range': dac_limit,
        "the drive's control_limit": plant.control_limit,
    }
    smallest = min(limits, key=limits.__getitem__)
    limited = np.abs(unsaturated) > limits[smallest]
    quantization, delay = f'dsp.dac_bits {dsp.dac_bits}', f'dsp.computation_delay {dsp.computation_delay}'
    if dsp.dac_bits > 0:
        rounded = float(np.abs(u - unsaturated)[~limited].max(initial=0.0))
        quantization += f': u rounded by up to {rounded:.3g}, which the theorem does not cover'
    if dsp.computation_delay > 0:
        delay += f': u delayed by {dsp.computation_delay * sample_time:g} s, which the theorem does not cover'
    interpolation = 'u constant over each sample'
    if dsp.is_interpolated:
        interpolation = f'u in {dsp.updates_per_sample} steps per sample, which the theorem does not cover'
    filters = 'u not filtered'
    if dsp.filters.is_used:
        filters = 'u filtered after the law, which the theorem does not cover'
    return {
        'saturation': (
            not limited.any(),
            f'u was limited at {int(limited.sum())} ticks; the limit of {smallest} is {limits[smallest]:.6g}',
        ),
        'dsp.dac_bits': (dsp.dac_bits == 0, quantization),
        'dsp.computation_delay': (dsp.computation_delay == 0, delay),
        'dsp.interpolation': (not dsp.is_interpolated, interpolation),
        'dsp.filters': (not dsp.filters.is_used, filters),
    }


def _smooth(signals: Signals, controller: AdaptiveNnParameters, sample_time: float) -> tuple[bool, str]:
    """Return whether x_d and its derivative are free of steps, each of which makes r, and so V, jump."""
    x, v, a = signals.reference.T
    gain = controller.error_filter_lambda
    jumps = np.abs(np.diff(v) - 0.5 * sample_time * (a[1:] + a[:-1]))
    jumps += gain * np.abs(np.diff(x) - 0.5 * sample_time * (v[1:] + v[:-1]))
    scale = float(np.abs(v).max() + gain * np.abs(x).max())
    count = int((jumps > _JUMP * scale).sum())
    return count == 0, f'{count} steps'


def _projection(
    condition: str, controller: AdaptiveNnParameters, certificates: Sequence[Certificate]
) -> list[Condition]:
    """Return the condition of projection for each choice of the ideal values; empty without projection."""
    if not controller.projection:
        return []
    return [
        Condition(f'{condition} ({each.kind})', projection_allows(controller, each.ideal), 'minimum and maximum')
        for each in certificates
    ]
