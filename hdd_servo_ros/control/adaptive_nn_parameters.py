"""Parameters of the adaptive neural network controller, described in docs/controllers/adaptive-nn.md."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

VELOCITY_SOURCES = ('sensor', 'difference')
NETWORK_INPUTS = ('measured', 'reference')


def _scale(default: float, regressor: str, unit: str) -> Any:
    """Declare the scale of the normalization of an adaptation law."""
    text = (
        f'amplitude of the regressor {regressor} at which the adaptation rate with desired compensation reaches half '
        'of its maximum; the gain is divided by 1 + (held peak of the regressor/scale)^2; 0 disables the normalization'
    )
    return parameter(default, text, unit=unit, minimum=0.0)


BARE_LAW: Mapping[str, object] = {
    'desired.enabled': False,
    'bristle.enabled': False,
    'integral_gain': 0.0,
    'shaping.share': 0.0,
    'projection': False,
    'r_limit': 0.0,
    'sigma.initial': 0.0,
    'mass.initial': 0.0,
    'mass.minimum': -1.0e-7,
    'mass.maximum': 1.0e-7,
}
"""Disables every option beyond the thesis that is on by default: leaves (4.10)-(4.21), with zero initial estimates."""


@dataclasses.dataclass(frozen=True)
class BoundedEstimate(ParameterSet):
    """Bounds of an estimate; base class of its parameters."""

    def check_together(self) -> None:
        """Check that ``minimum`` and ``maximum`` are in order; raises :class:`ParameterError`."""
        minimum, maximum = (getattr(self, name) for name in ('minimum', 'maximum'))
        if minimum > maximum:
            raise ParameterError('minimum', minimum, f'at most maximum = {maximum:g}')


@dataclasses.dataclass(frozen=True)
class SigmaParameters(BoundedEstimate):
    """Parameters of the viscous friction estimate sigma_hat, thesis eq. (4.18)."""

    enabled: bool = parameter(True, 'enable the viscous friction term sigma_hat')
    gain: float = parameter(
        2.24e-5,
        'adaptation gain k_sigma; the estimate diverges with the negative sign printed in section 5.5',
        unit='V s^2/um^3',
        equation='4.18',
    )
    leakage: float = parameter(1.33e3, 'leakage sigma_sigma', unit='um^3/(V s^3)', minimum=0.0, equation='4.18')
    initial: float = parameter(6.9e-6, 'initial estimate sigma_hat(0)', unit='V s/um')
    minimum: float = parameter(-4.0e-5, 'lower bound of sigma_hat, with projection', unit='V s/um')
    maximum: float = parameter(4.0e-5, 'upper bound of sigma_hat, with projection', unit='V s/um')
    scale: float = _scale(30.0, "x_d' of sigma_hat", 'um/s')


@dataclasses.dataclass(frozen=True)
class MassParameters(BoundedEstimate):
    """
    Parameters of the inertia estimate m_hat, thesis eq. (4.19).

    Without desired compensation it converges to a negative effective mass below the presliding resonance.
    """

    enabled: bool = parameter(True, 'enable the inertia term m_hat')
    gain: float = parameter(
        2.02e-10,
        'adaptation gain k_m; the estimate diverges with the negative sign printed in section 5.5',
        unit='V s^4/um^3',
        equation='4.19',
    )
    leakage: float = parameter(1.48e8, 'leakage sigma_m', unit='um^3/(V s^5)', minimum=0.0, equation='4.19')
    initial: float = parameter(2.44e-8, 'initial estimate m_hat(0)', unit='V s^2/um')
    minimum: float = parameter(1.4e-8, 'lower bound of m_hat, with projection', unit='V s^2/um')
    maximum: float = parameter(3.5e-8, 'upper bound of m_hat, with projection', unit='V s^2/um')
    scale: float = _scale(1.0e4, "x_d'' of m_hat", 'um/s^2')


@dataclasses.dataclass(frozen=True)
class PhiParameters(BoundedEstimate):
    """Parameters of phi_hat, the estimated bound on network error and disturbance, thesis eq. (4.20)."""

    enabled: bool = parameter(True, 'enable the robust term phi_hat sgn(r)')
    gain: float = parameter(1.26e-5, 'adaptation gain k_phi', unit='V/um', minimum=0.0, equation='4.20')
    leakage: float = parameter(3.97e5, 'leakage sigma_phi', unit='um/(V s)', minimum=0.0, equation='4.20')
    initial: float = parameter(0.0, 'initial estimate phi_hat(0)', unit='V', minimum=0.0)
    minimum: float = parameter(0.0, 'lower bound of phi_hat, with projection', unit='V')
    maximum: float = parameter(0.2, 'upper bound of phi_hat, with projection', unit='V')


@dataclasses.dataclass(frozen=True)
class NetworkParameters(ParameterSet):
    """Parameters of the network W_hat'S(x, v) that bounds the friction, thesis eqs. (4.7), (4.14) and (4.21)."""

    enabled: bool = parameter(True, "enable the network term W_hat'S sgn(r)")
    nodes: int = parameter(5, 'number of nodes per axis: n of the n x n lattice', minimum=1, maximum=32, read_only=True)
    gain: tuple[float, ...] = parameter(
        (7.81e-6,),
        'adaptation gain Gamma: one element, or the n x n diagonal (position index first)',
        unit='V/um',
        minimum=0.0,
        equation='4.21',
    )
    leakage: float = parameter(6.41e5, 'leakage sigma_w', unit='um/(V s)', minimum=0.0, equation='4.21')
    initial: tuple[float, ...] = parameter((0.0,), 'initial weights W_hat(0): one element, or one per node', unit='V')
    position_minimum: float = parameter(-6.0, 'first position center', unit='um')
    position_maximum: float = parameter(6.0, 'last position center', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity center', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity center', unit='um/s')
    normalize_inputs: bool = parameter(
        True, 'scale the inputs so that the lattice spans -1 to 1 on both axes; the widths are in the same scale'
    )
    width: tuple[float, ...] = parameter(
        (0.5,),
        'width eta of the basis functions: one element, or one for position and one for velocity; in half ranges with '
        'normalize_inputs, otherwise in um and um/s',
        above=0.0,
        equation='4.7',
    )
    input: str = parameter(
        'measured',
        'input Z of the network: measured position and velocity, or those of the reference',
        choices=NETWORK_INPUTS,
        equation='4.7',
    )
    maximum: float = parameter(0.2, 'largest magnitude of a weight, with projection', unit='V', minimum=0.0)

    def check_together(self) -> None:
        """Check ranges and lengths; raises :class:`ParameterError`."""
        _check_range('position_maximum', self.position_minimum, self.position_maximum)
        _check_range('velocity_maximum', self.velocity_minimum, self.velocity_maximum)
        count = self.nodes * self.nodes
        for name in ('gain', 'initial'):
            if len(getattr(self, name)) not in (1, count):
                raise ParameterError(name, getattr(self, name), f'1 or nodes x nodes = {count} elements')
        if len(self.width) not in (1, 2):
            raise ParameterError('width', self.width, '1 or 2 elements')

    @property
    def axis_widths(self) -> tuple[float, float]:
        """Widths of the position and velocity axes in um and um/s."""
        position, velocity = self.width[0], self.width[-1]
        if self.normalize_inputs:
            position *= 0.5 * (self.position_maximum - self.position_minimum)
            velocity *= 0.5 * (self.velocity_maximum - self.velocity_minimum)
        return position, velocity


@dataclasses.dataclass(frozen=True)
class WidthParameters(ParameterSet):
    """Option beyond the thesis: adaptive lattice widths (docs/concepts/stability-certificate.md derives the law)."""

    enabled: bool = parameter(False, 'enable the adaptation of the widths')
    gain: float = parameter(1.0e3, 'adaptation gain gamma_eta of the widths', unit='1/(V um)', minimum=0.0)
    leakage: float = parameter(
        1.0e-4, 'leakage sigma_eta of the widths, toward the initial ones', unit='V um/s', minimum=0.0
    )
    factor: float = parameter(
        3.0, 'bound on the widths: from initial width/factor to initial width times factor', above=1.0
    )


@dataclasses.dataclass(frozen=True)
class CompensatorParameters(ParameterSet):
    """Option beyond the thesis: signed reference network that learns the friction."""

    enabled: bool = parameter(False, 'enable the hysteresis compensator')
    nodes: int = parameter(7, 'number of nodes per axis', minimum=1, maximum=32, read_only=True)
    gain: float = parameter(1.0e-3, 'adaptation gain Gamma_c', unit='V/um', minimum=0.0)
    leakage: float = parameter(100.0, 'leakage sigma_c', unit='um/(V s)', minimum=0.0)
    lag: float = parameter(
        3.0e-4,
        'delay from the compensator output to its effect on r; the adaptation law uses S_c of the reference delayed by '
        'this time (filtered-x)',
        unit='s',
        minimum=0.0,
    )
    position_minimum: float = parameter(-3.0, 'first position center', unit='um')
    position_maximum: float = parameter(3.0, 'last position center', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity center', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity center', unit='um/s')
    width: float = parameter(0.35, 'width of the basis functions in half ranges', above=0.0)
    maximum: float = parameter(0.2, 'largest magnitude of a weight, with projection', unit='V', minimum=0.0)

    def check_together(self) -> None:
        """Check the ranges; raises :class:`ParameterError`."""
        _check_range('position_maximum', self.position_minimum, self.position_maximum)
        _check_range('velocity_maximum', self.velocity_minimum, self.velocity_maximum)


@dataclasses.dataclass(frozen=True)
class DesiredParameters(ParameterSet):
    """Option beyond the thesis: sigma_hat and m_hat multiply reference signals."""

    enabled: bool = parameter(
        True,
        'multiply sigma_hat and m_hat by the velocity and the acceleration of the reference, not by v and a_r',
    )
    lag: float = parameter(
        3.0e-4,
        'delay from the feedforward to its effect on r; the laws use the regressors delayed by this time, rounded to '
        'samples',
        unit='s',
        minimum=0.0,
        maximum=0.1,
        read_only=True,
    )
    peak_decay: float = parameter(2.0, 'decay rate of the held peak of a squared regressor', unit='1/s', minimum=0.0)

    def ticks(self, sample_time: float) -> int:
        """Return the lag in samples of T = ``sample_time`` [s]."""
        return round(self.lag / sample_time)


@dataclasses.dataclass(frozen=True)
class SpringParameters(BoundedEstimate):
    """Parameters of spring_hat, the estimated stiffness of the wider bristle."""

    gain: float = parameter(2.02, 'adaptation gain of spring_hat', unit='V/um^3', minimum=0.0)
    leakage: float = parameter(1.48e-2, 'leakage of spring_hat', unit='um^3/(V s)', minimum=0.0)
    initial: float = parameter(0.0217, 'initial estimate spring_hat(0)', unit='V/um')
    minimum: float = parameter(-0.05, 'lower bound of spring_hat, with projection', unit='V/um')
    maximum: float = parameter(0.05, 'upper bound of spring_hat, with projection', unit='V/um')
    scale: float = _scale(0.1, 'z_2 of spring_hat (deflection of the wider bristle)', 'um')


@dataclasses.dataclass(frozen=True)
class HysteresisParameters(BoundedEstimate):
    """Parameters of hysteresis_hat, the estimated stiffness of the difference between both bristles."""

    gain: float = parameter(151.0, 'adaptation gain of hysteresis_hat', unit='V/um^3', minimum=0.0)
    leakage: float = parameter(1.98e-4, 'leakage of hysteresis_hat', unit='um^3/(V s)', minimum=0.0)
    initial: float = parameter(0.0217, 'initial estimate hysteresis_hat(0)', unit='V/um')
    minimum: float = parameter(0.0, 'lower bound of hysteresis_hat, with projection', unit='V/um')
    maximum: float = parameter(0.06, 'upper bound of hysteresis_hat, with projection', unit='V/um')
    scale: float = _scale(0.02, 'z_1 - z_2 of hysteresis_hat (difference of the bristle deflections)', 'um')


@dataclasses.dataclass(frozen=True)
class RelaxationParameters(BoundedEstimate):
    """Parameters of relaxation_hat, the estimated damping of the bristles."""

    gain: float = parameter(4.04e-6, 'adaptation gain of relaxation_hat', unit='V s^2/um^3', minimum=0.0)
    leakage: float = parameter(7.42e3, 'leakage of relaxation_hat', unit='um^3/(V s^3)', minimum=0.0)
    initial: float = parameter(2.3e-6, 'initial estimate relaxation_hat(0)', unit='V s/um')
    minimum: float = parameter(0.0, 'lower bound of relaxation_hat, with projection', unit='V s/um')
    maximum: float = parameter(2.0e-5, 'upper bound of relaxation_hat, with projection', unit='V s/um')
    scale: float = _scale(100.0, "abs(x_d') z_1/d_1 of relaxation_hat", 'um/s')


@dataclasses.dataclass(frozen=True)
class BristleParameters(ParameterSet):
    """Option beyond the thesis: feedforward of the presliding friction by two bristles driven by the reference."""

    enabled: bool = parameter(True, 'enable the compensation of bristle friction; needs desired.enabled')
    distance: float = parameter(6.0, 'breakaway distance d_1 of the friction', unit='um', above=0.0)
    spring_distance: float = parameter(
        30.0, 'breakaway distance d_2 of the wider bristle, which is almost a spring', unit='um', above=0.0
    )
    spring: SpringParameters = group(SpringParameters)
    hysteresis: HysteresisParameters = group(HysteresisParameters)
    relaxation: RelaxationParameters = group(RelaxationParameters)

    def check_together(self) -> None:
        """Check that the distances differ; raises :class:`ParameterError`."""
        if not self.spring_distance > self.distance:
            raise ParameterError('spring_distance', self.spring_distance, f'above distance = {self.distance:g} [um]')


@dataclasses.dataclass(frozen=True)
class ShapingParameters(ParameterSet):
    """Option beyond the thesis: a step of the reference is applied in two parts."""

    share: float = parameter(
        0.075, 'fraction of a reference step that is delayed (input shaping); 0 disables it', minimum=0.0, maximum=1.0
    )
    delay: float = parameter(1.1e-3, 'delay of this fraction, rounded to samples', unit='s', minimum=0.0)

    def ticks(self, sample_time: float) -> float:
        """Return the delay in samples of T = ``sample_time`` [s]."""
        return float(round(self.delay / sample_time))


@dataclasses.dataclass(frozen=True)
class AdaptiveNnParameters(ParameterSet):
    """Parameters of :class:`AdaptiveNn`; ``studies/tune.py`` finds these gains for the drive of chapter 5."""

    error_filter_lambda: float = parameter(
        2450.0, 'error filter constant lambda', unit='1/s', minimum=0.0, equation='4.10'
    )
    feedback_gain: float = parameter(
        9.59e-5, 'feedback gain k on the filtered error r', unit='V s/um', minimum=0.0, equation='4.16'
    )
    boundary_layer: float = parameter(
        0.0,
        'half-width of the boundary layer in r in which sgn(r) is linear; 0 for the exact sgn with sgn 0 = 0',
        unit='um/s',
        minimum=0.0,
        equation='4.16',
    )
    control_limit: float = parameter(10.0, 'largest magnitude of the drive voltage', unit='V', above=0.0)
    freeze_when_saturated: bool = parameter(
        True, 'freeze the estimates and the integral while the drive voltage is saturated'
    )
    sigma: SigmaParameters = group(SigmaParameters)
    mass: MassParameters = group(MassParameters)
    phi: PhiParameters = group(PhiParameters)
    network: NetworkParameters = group(NetworkParameters)
    velocity_source: str = parameter(
        'sensor',
        'source of the velocity: the velocity output of the sensor, or the filtered difference of the displacement; '
        'the reference then passes the same filter',
        choices=VELOCITY_SOURCES,
    )
    filter_reference: bool = parameter(
        True,
        'pass the reference through the same filter, with velocity_source = difference; false uses the velocity of '
        '/reference unfiltered, so that only the measurement is delayed, which shows the cost of that delay',
        read_only=True,
    )
    velocity_bandwidth: float = parameter(
        2000.0, 'corner frequency of the first-order low pass on the difference, 0 for none', unit='Hz', minimum=0.0
    )
    integral_gain: float = parameter(
        4.6e5,
        "integral gain lambda_i of r = e' + lambda e + lambda_i int e dt (beyond the thesis)",
        unit='1/s^2',
        minimum=0.0,
    )
    desired: DesiredParameters = group(DesiredParameters)
    bristle: BristleParameters = group(BristleParameters)
    shaping: ShapingParameters = group(ShapingParameters)
    projection: bool = parameter(
        True, 'keep the estimates between their minimum and maximum (projection; beyond the thesis)'
    )
    r_limit: float = parameter(
        300.0,
        'bound on the magnitude of r in the adaptation laws (beyond the thesis); 0 for no bound',
        unit='um/s',
        minimum=0.0,
    )
    width: WidthParameters = group(WidthParameters)
    compensator: CompensatorParameters = group(CompensatorParameters)
    reset_count: int = parameter(
        0,
        'changing this value resets all estimates and weights to their initial values; the ~/reset service '
        'increments it',
        minimum=0,
    )
    safe_gain: float = parameter(
        1.01e-4,
        "largest linear gain on r, k + 1/sigma_phi + max(S'S)/sigma_w, with a sufficient stability margin; 0 if "
        'unknown; a larger gain causes a warning in a run without vcm_plant (with it, the drive model is checked)',
        unit='V s/um',
        minimum=0.0,
    )

    @property
    def laws(self) -> dict[str, Any]:
        """Parameter groups of the bounded scalar estimates, by their ROS names."""
        bristle = self.bristle
        return {
            'sigma': self.sigma,
            'mass': self.mass,
            'phi': self.phi,
            'bristle.spring': bristle.spring,
            'bristle.hysteresis': bristle.hysteresis,
            'bristle.relaxation': bristle.relaxation,
        }

    @property
    def adapted(self) -> dict[str, Any]:
        """Parameter groups of the scalar estimates that adapt, by the names of the estimates."""
        bristle = self.bristle
        own: dict[str, Any] = {'sigma_hat': self.sigma, 'm_hat': self.mass, 'phi_hat': self.phi}
        found: dict[str, Any] = {name: law for name, law in own.items() if law.enabled}
        if bristle.enabled:
            found |= {
                'spring_hat': bristle.spring,
                'hysteresis_hat': bristle.hysteresis,
                'relaxation_hat': bristle.relaxation,
            }
        return found

    def check_together(self) -> None:
        """Check options that need another, and initial values against the projection bounds; raises ParameterError."""
        if self.bristle.enabled and not self.desired.enabled:
            raise ParameterError('bristle.enabled', True, 'false, as desired.enabled is false')
        if not self.projection:
            return
        for name, law in self.laws.items():
            if not law.minimum <= law.initial <= law.maximum:
                allowed = f'with projection from minimum = {law.minimum:g} to maximum = {law.maximum:g}'
                raise ParameterError(f'{name}.initial', law.initial, allowed)
        if max(abs(weight) for weight in self.network.initial) > self.network.maximum:
            allowed = f'with projection within +- maximum = {self.network.maximum:g}'
            raise ParameterError('network.initial', self.network.initial, allowed)


def _check_range(name: str, minimum: float, maximum: float) -> None:
    if not maximum > minimum:
        # Either of the two may have changed.
        raise ParameterError(name, maximum, f'above {name.replace("maximum", "minimum")} = {minimum:g}')
