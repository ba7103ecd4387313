"""Parameters of the adaptive neural network controller; docs/controllers.md relates them to the thesis's symbols."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

VELOCITY_SOURCES = ('sensor', 'difference')
NETWORK_INPUTS = ('measured', 'reference')

SCALE_TEXT = (
    'with desired compensation: excitation at which the learning rate has reached half of its largest value; '
    'the gain is divided by 1 + (held peak of the regressor/scale)^2; 0 for no normalization'
)


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
"""Switches off every option beyond the thesis that is on by default: (4.10)-(4.21) are left, with zero estimates."""


@dataclasses.dataclass(frozen=True)
class BoundedEstimate(ParameterSet):
    """What the parameters of an estimate with bounds share."""

    def check_together(self) -> None:
        """Check that ``minimum`` and ``maximum`` are in order; raises :class:`ParameterError`."""
        minimum, maximum = (getattr(self, name) for name in ('minimum', 'maximum'))
        if minimum > maximum:
            raise ParameterError('minimum', minimum, f'at most maximum = {maximum:g}')


@dataclasses.dataclass(frozen=True)
class SigmaParameters(BoundedEstimate):
    """The viscous estimate sigma_hat, (4.18)."""

    enabled: bool = parameter(True, 'whether sigma_hat takes part')
    gain: float = parameter(
        2.24e-5, 'k_sigma of (4.18); negative, as section 5.5 prints it, it diverges', unit='V s^2/um^3'
    )
    leakage: float = parameter(1.33e3, 'sigma_sigma of (4.18)', unit='um^3/(V s^3)', minimum=0.0)
    initial: float = parameter(6.9e-6, 'estimate at tick 0, sigma_hat(0)', unit='V s/um')
    minimum: float = parameter(-4.0e-5, 'smallest sigma_hat, with projection', unit='V s/um')
    maximum: float = parameter(4.0e-5, 'largest sigma_hat, with projection', unit='V s/um')
    scale: float = parameter(30.0, SCALE_TEXT, unit='um/s', minimum=0.0)


@dataclasses.dataclass(frozen=True)
class MassParameters(BoundedEstimate):
    """
    The inertia estimate m_hat, (4.19).

    Without desired compensation it learns a negative, effective mass below the presliding resonance.
    """

    enabled: bool = parameter(True, 'whether m_hat takes part')
    gain: float = parameter(
        2.02e-10, 'k_m of (4.19); negative, as section 5.5 prints it, it diverges', unit='V s^4/um^3'
    )
    leakage: float = parameter(1.48e8, 'sigma_m of (4.19)', unit='um^3/(V s^5)', minimum=0.0)
    initial: float = parameter(2.44e-8, 'estimate at tick 0, m_hat(0)', unit='V s^2/um')
    minimum: float = parameter(1.4e-8, 'smallest m_hat, with projection', unit='V s^2/um')
    maximum: float = parameter(3.5e-8, 'largest m_hat, with projection', unit='V s^2/um')
    scale: float = parameter(1.0e4, SCALE_TEXT, unit='um/s^2', minimum=0.0)


@dataclasses.dataclass(frozen=True)
class PhiParameters(BoundedEstimate):
    """The bound estimate phi_hat of network error and disturbance, (4.20)."""

    enabled: bool = parameter(True, 'whether phi_hat takes part')
    gain: float = parameter(1.26e-5, 'k_phi of (4.20)', unit='V/um', minimum=0.0)
    leakage: float = parameter(3.97e5, 'sigma_phi of (4.20)', unit='um/(V s)', minimum=0.0)
    initial: float = parameter(0.0, 'estimate at tick 0, phi_hat(0)', unit='V', minimum=0.0)
    minimum: float = parameter(0.0, 'smallest phi_hat, with projection', unit='V')
    maximum: float = parameter(0.2, 'largest phi_hat, with projection', unit='V')


@dataclasses.dataclass(frozen=True)
class NetworkParameters(ParameterSet):
    """The network W_hat'S(x, v) that bounds the friction, (4.7), (4.14) and (4.21)."""

    enabled: bool = parameter(True, 'whether the network takes part')
    nodes: int = parameter(5, 'nodes an axis: n of the n x n lattice', minimum=1, maximum=32, read_only=True)
    gain: tuple[float, ...] = parameter(
        (7.81e-6,),
        'Gamma of (4.21): one number, or the n x n diagonal (position index first)',
        unit='V/um',
        minimum=0.0,
    )
    leakage: float = parameter(6.41e5, 'sigma_w of (4.21)', unit='um/(V s)', minimum=0.0)
    initial: tuple[float, ...] = parameter((0.0,), 'W_hat(0): one number, or one a node', unit='V')
    position_minimum: float = parameter(-6.0, 'first position center', unit='um')
    position_maximum: float = parameter(6.0, 'last position center', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity center', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity center', unit='um/s')
    normalize_inputs: bool = parameter(
        True, 'whether the inputs are scaled so that the lattice spans -1 to 1 on both axes; widths count in that scale'
    )
    width: tuple[float, ...] = parameter(
        (0.5,),
        'eta of (4.7): one number, or one for position and one for velocity; in half ranges with normalize_inputs, '
        'else in the units of position and velocity',
        above=0.0,
    )
    input: str = parameter(
        'measured', 'Z of (4.7): the measured position and velocity, or those of the reference', choices=NETWORK_INPUTS
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
        """The widths of the position and velocity axis in their own units [um], [um/s]."""
        position, velocity = self.width[0], self.width[-1]
        if self.normalize_inputs:
            position *= 0.5 * (self.position_maximum - self.position_minimum)
            velocity *= 0.5 * (self.velocity_maximum - self.velocity_minimum)
        return position, velocity


@dataclasses.dataclass(frozen=True)
class WidthParameters(ParameterSet):
    """Option beyond the thesis: the two widths of the lattice adapt (docs/controllers.md derives the law)."""

    enabled: bool = parameter(False, 'whether the widths adapt')
    gain: float = parameter(1.0e3, 'gamma_eta', unit='1/(V um)', minimum=0.0)
    leakage: float = parameter(1.0e-4, 'sigma_eta, toward the initial widths', unit='V um/s', minimum=0.0)
    factor: float = parameter(3.0, 'the widths stay between the initial ones over and times this', above=1.0)


@dataclasses.dataclass(frozen=True)
class CompensatorParameters(ParameterSet):
    """Option beyond the thesis: a signed network over the reference learns the friction (docs/controllers.md)."""

    enabled: bool = parameter(False, 'whether the compensator takes part')
    nodes: int = parameter(7, 'nodes an axis', minimum=1, maximum=32, read_only=True)
    gain: float = parameter(1.0e-3, 'adaptation gain Gamma_c', unit='V/um', minimum=0.0)
    leakage: float = parameter(100.0, 'leakage sigma_c', unit='um/(V s)', minimum=0.0)
    lag: float = parameter(
        3.0e-4,
        'time by which r answers the compensator late: the law learns with S_c of the reference this long ago',
        unit='s',
        minimum=0.0,
    )
    position_minimum: float = parameter(-3.0, 'first position center', unit='um')
    position_maximum: float = parameter(3.0, 'last position center', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity center', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity center', unit='um/s')
    width: float = parameter(0.35, 'width in half ranges', above=0.0)
    maximum: float = parameter(0.2, 'largest magnitude of a weight, with projection', unit='V', minimum=0.0)

    def check_together(self) -> None:
        """Check the ranges; raises :class:`ParameterError`."""
        _check_range('position_maximum', self.position_minimum, self.position_maximum)
        _check_range('velocity_maximum', self.velocity_minimum, self.velocity_maximum)


@dataclasses.dataclass(frozen=True)
class DesiredParameters(ParameterSet):
    """Option beyond the thesis: sigma_hat and m_hat multiply the reference's signals (docs/controllers.md)."""

    enabled: bool = parameter(
        True,
        'whether sigma_hat and m_hat multiply the velocity and the acceleration of the reference instead of v and a_r',
    )
    lag: float = parameter(
        3.0e-4,
        'delay from the feedforward to its effect on r: the laws use the regressors delayed by this time, rounded to '
        'samples',
        unit='s',
        minimum=0.0,
        maximum=0.1,
        read_only=True,
    )
    peak_decay: float = parameter(
        2.0, 'rate at which the held peak of the square of a regressor decays', unit='1/s', minimum=0.0
    )

    def ticks(self, sample_time: float) -> int:
        """Return the lag in samples of T = ``sample_time`` [s]."""
        return round(self.lag / sample_time)


@dataclasses.dataclass(frozen=True)
class SpringParameters(BoundedEstimate):
    """The stiffness estimate of the wider bristle, spring_hat."""

    gain: float = parameter(2.02, 'adaptation gain of spring_hat', unit='V/um^3', minimum=0.0)
    leakage: float = parameter(1.48e-2, 'leakage of spring_hat', unit='um^3/(V s)', minimum=0.0)
    initial: float = parameter(0.0217, 'estimate at tick 0, spring_hat(0)', unit='V/um')
    minimum: float = parameter(-0.05, 'smallest spring_hat, with projection', unit='V/um')
    maximum: float = parameter(0.05, 'largest spring_hat, with projection', unit='V/um')
    scale: float = parameter(0.1, SCALE_TEXT, unit='um', minimum=0.0)


@dataclasses.dataclass(frozen=True)
class HysteresisParameters(BoundedEstimate):
    """The stiffness estimate of the difference between both bristles, hysteresis_hat."""

    gain: float = parameter(151.0, 'adaptation gain of hysteresis_hat', unit='V/um^3', minimum=0.0)
    leakage: float = parameter(1.98e-4, 'leakage of hysteresis_hat', unit='um^3/(V s)', minimum=0.0)
    initial: float = parameter(0.0217, 'estimate at tick 0, hysteresis_hat(0)', unit='V/um')
    minimum: float = parameter(0.0, 'smallest hysteresis_hat, with projection', unit='V/um')
    maximum: float = parameter(0.06, 'largest hysteresis_hat, with projection', unit='V/um')
    scale: float = parameter(0.02, SCALE_TEXT, unit='um', minimum=0.0)


@dataclasses.dataclass(frozen=True)
class RelaxationParameters(BoundedEstimate):
    """The bristle damping estimate, relaxation_hat."""

    gain: float = parameter(4.04e-6, 'adaptation gain of relaxation_hat', unit='V s^2/um^3', minimum=0.0)
    leakage: float = parameter(7.42e3, 'leakage of relaxation_hat', unit='um^3/(V s^3)', minimum=0.0)
    initial: float = parameter(2.3e-6, 'estimate at tick 0, relaxation_hat(0)', unit='V s/um')
    minimum: float = parameter(0.0, 'smallest relaxation_hat, with projection', unit='V s/um')
    maximum: float = parameter(2.0e-5, 'largest relaxation_hat, with projection', unit='V s/um')
    scale: float = parameter(100.0, SCALE_TEXT, unit='um/s', minimum=0.0)


@dataclasses.dataclass(frozen=True)
class BristleParameters(ParameterSet):
    """Option beyond the thesis: desired compensation of the presliding friction by two bristles of the reference."""

    enabled: bool = parameter(True, 'whether the friction of the bristles is compensated; needs desired.enabled')
    distance: float = parameter(6.0, 'breakaway distance d_1 of the friction', unit='um', above=0.0)
    spring_distance: float = parameter(
        30.0, 'breakaway distance d_2 of the wider bristle, which is nearly a spring', unit='um', above=0.0
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
    """Option beyond the thesis: a jump of the reference is taken in two parts (docs/controllers.md)."""

    share: float = parameter(
        0.075, 'part of a jump of the reference that is taken later, 0 to take it whole', minimum=0.0, maximum=1.0
    )
    delay: float = parameter(1.1e-3, 'by how much later, to the nearest sample', unit='s', minimum=0.0)

    def ticks(self, sample_time: float) -> float:
        """Return the delay in samples of T = ``sample_time`` [s]."""
        return float(round(self.delay / sample_time))


@dataclasses.dataclass(frozen=True)
class AdaptiveNnParameters(ParameterSet):
    """Parameters of :class:`AdaptiveNn`; the gains are those of ``studies/tune.py`` for the drive of chapter 5."""

    error_filter_lambda: float = parameter(2450.0, 'lambda of (4.10)', unit='1/s', minimum=0.0)
    feedback_gain: float = parameter(9.59e-5, 'k of (4.16)', unit='V s/um', minimum=0.0)
    boundary_layer: float = parameter(
        0.0, 'sgn(r) of (4.16) grows linearly over +- this; 0 is the true sgn with sgn 0 = 0', unit='um/s', minimum=0.0
    )
    control_limit: float = parameter(10.0, 'largest magnitude of the drive voltage', unit='V', above=0.0)
    freeze_when_saturated: bool = parameter(
        True, 'whether the estimates and the integral rest while the drive voltage is limited'
    )
    sigma: SigmaParameters = group(SigmaParameters)
    mass: MassParameters = group(MassParameters)
    phi: PhiParameters = group(PhiParameters)
    network: NetworkParameters = group(NetworkParameters)
    velocity_source: str = parameter(
        'sensor',
        'where the velocity comes from: the velocity output of the sensor, or the filtered difference of displacement; '
        'the reference then goes through the same filter',
        choices=VELOCITY_SOURCES,
    )
    filter_reference: bool = parameter(
        True,
        'with velocity_source difference, whether the reference goes through the same filter; false takes its given '
        'velocity, so that the filter delays the measurement alone: to show what that costs',
        read_only=True,
    )
    velocity_bandwidth: float = parameter(
        2000.0, 'corner frequency of the first-order low pass on the difference, 0 for none', unit='Hz', minimum=0.0
    )
    integral_gain: float = parameter(
        4.6e5, "option beyond the thesis: lambda_i of r = e' + lambda e + lambda_i int e dt", unit='1/s^2', minimum=0.0
    )
    desired: DesiredParameters = group(DesiredParameters)
    bristle: BristleParameters = group(BristleParameters)
    shaping: ShapingParameters = group(ShapingParameters)
    projection: bool = parameter(
        True, 'option beyond the thesis: whether the estimates are kept inside their minimum and maximum'
    )
    r_limit: float = parameter(
        300.0,
        'option beyond the thesis: r counts in the adaptation laws up to this magnitude, 0 for no limit',
        unit='um/s',
        minimum=0.0,
    )
    width: WidthParameters = group(WidthParameters)
    compensator: CompensatorParameters = group(CompensatorParameters)
    reset_count: int = parameter(
        0, 'every other number than before resets what was learned; what ~/reset raises by one', minimum=0
    )
    safe_gain: float = parameter(
        1.01e-4,
        "largest linear gain on r, k + 1/sigma_phi + max(S'S)/sigma_w, that the loop is known to bear, 0 if not known; "
        'a warning says when it is exceeded in a run without vcm_plant (with it, the drive itself is judged)',
        unit='V s/um',
        minimum=0.0,
    )

    @property
    def laws(self) -> dict[str, Any]:
        """The parameter groups of the scalar estimates with bounds, by their ROS names."""
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
        """The parameter groups of those of these estimates that adapt, by the names of the estimates."""
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
        """Check what needs another option, and that projection starts inside its bounds; raises ParameterError."""
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
        # Either of the two may be the one that was changed.
        raise ParameterError(name, maximum, f'above {name.replace("maximum", "minimum")} = {minimum:g}')
