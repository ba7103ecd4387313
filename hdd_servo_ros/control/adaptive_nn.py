"""The adaptive neural network controller of chapter 4, (4.10)-(4.21)."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.adaptation import decay_and_step
from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.control.rbf import fill_axis, largest_square_sum, lattice
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

VELOCITY_SOURCES = ('sensor', 'difference')
SENSOR, DIFFERENCE = range(len(VELOCITY_SOURCES))
NETWORK_INPUTS = ('measured', 'reference')
MEASURED, REFERENCE = range(len(NETWORK_INPUTS))

# Where the constants of adaptive_nn_step stand. A law has five: switch, a, b, smallest and largest estimate.
TIME_STEP, DISPLACEMENT_SCALE, VELOCITY_SCALE, VELOCITY_SOURCE, SMOOTHING = range(5)
LAMBDA, INTEGRAL_GAIN, FEEDBACK_GAIN, BOUNDARY_LAYER, CONTROL_LIMIT, FREEZE, R_LIMIT = range(5, 12)
SIGMA_LAW, MASS_LAW, PHI_LAW, WIDTH_LAW = range(12, 32, 5)
NETWORK, NODES, NETWORK_INPUT, POSITION_INVERSE, VELOCITY_INVERSE, WEIGHT_LIMIT = range(32, 38)
COMPENSATOR, COMPENSATOR_NODES, COMPENSATOR_POSITION, COMPENSATOR_VELOCITY = range(38, 42)
COMPENSATOR_DECAY, COMPENSATOR_STEP, COMPENSATOR_ADVANCE = range(42, 45)
CENTRES = 45
# From CENTRES on: n position and n velocity centres, n^2 decays and n^2 steps of W, then the compensator's centres.

# Where its state stands; then n + n activations, n^2 weights, and the same of the compensator.
SIGMA, MASS, PHI, POSITION_WIDTH, VELOCITY_WIDTH, INTEGRAL = range(6)
LAST_POSITION, LAST_REFERENCE, MEASURED_VELOCITY, REFERENCE_VELOCITY, STARTED = range(6, 11)
ACTIVATIONS = 11

ESTIMATE_NAMES = (
    't',
    'r',
    'sigma_hat',
    'm_hat',
    'phi_hat',
    'W_norm',
    'e',
    'network',
    'integral',
    'position_width',
    'velocity_width',
    'compensator',
)


@dataclasses.dataclass(frozen=True)
class SigmaParameters(ParameterSet):
    """The viscous estimate sigma_hat, (4.18)."""

    enabled: bool = parameter(True, 'whether sigma_hat takes part')
    gain: float = parameter(1.0e-12, 'k_sigma of (4.18)', unit='V s^2/um^3', minimum=0.0)
    leakage: float = parameter(1.0e10, 'sigma_sigma of (4.18)', unit='um^3/(V s^3)', minimum=0.0)
    initial: float = parameter(0.0, 'sigma_hat(0)', unit='V s/um')
    minimum: float = parameter(-1.0, 'smallest sigma_hat, where projection is on', unit='V s/um')
    maximum: float = parameter(1.0, 'largest sigma_hat, where projection is on', unit='V s/um')

    def check_together(self) -> None:
        """Check that the bounds are in order; raises :class:`ParameterError`."""
        _check_bounds(self.minimum, self.maximum)


@dataclasses.dataclass(frozen=True)
class MassParameters(ParameterSet):
    """The inertia estimate m_hat, (4.19). Below the presliding resonance it learns a negative, effective mass."""

    enabled: bool = parameter(True, 'whether m_hat takes part')
    gain: float = parameter(1.0e-18, 'k_m of (4.19)', unit='V s^4/um^3', minimum=0.0)
    leakage: float = parameter(1.0e16, 'sigma_m of (4.19)', unit='um^3/(V s^5)', minimum=0.0)
    initial: float = parameter(0.0, 'm_hat(0)', unit='V s^2/um')
    minimum: float = parameter(-1.0, 'smallest m_hat, where projection is on', unit='V s^2/um')
    maximum: float = parameter(1.0, 'largest m_hat, where projection is on', unit='V s^2/um')

    def check_together(self) -> None:
        """Check that the bounds are in order; raises :class:`ParameterError`."""
        _check_bounds(self.minimum, self.maximum)


@dataclasses.dataclass(frozen=True)
class PhiParameters(ParameterSet):
    """The bound estimate phi_hat of network error and disturbance, (4.20)."""

    enabled: bool = parameter(True, 'whether phi_hat takes part')
    gain: float = parameter(1.0e-5, 'k_phi of (4.20)', unit='V/um', minimum=0.0)
    leakage: float = parameter(1.0e6, 'sigma_phi of (4.20)', unit='um/(V s)', minimum=0.0)
    initial: float = parameter(0.0, 'phi_hat(0)', unit='V', minimum=0.0)
    minimum: float = parameter(0.0, 'smallest phi_hat, where projection is on', unit='V')
    maximum: float = parameter(1.0, 'largest phi_hat, where projection is on', unit='V')

    def check_together(self) -> None:
        """Check that the bounds are in order; raises :class:`ParameterError`."""
        _check_bounds(self.minimum, self.maximum)


@dataclasses.dataclass(frozen=True)
class NetworkParameters(ParameterSet):
    """The network W_hat'S(x, v) that bounds the friction, (4.7), (4.14) and (4.21)."""

    enabled: bool = parameter(True, 'whether the network takes part')
    nodes: int = parameter(5, 'nodes an axis: n of the n x n lattice', minimum=1, maximum=32, read_only=True)
    gain: tuple[float, ...] = parameter(
        (1.0e-5,), 'Gamma of (4.21): one number, or the n x n diagonal (position index first)', unit='V/um', minimum=0.0
    )
    leakage: float = parameter(1.0e6, 'sigma_w of (4.21)', unit='um/(V s)', minimum=0.0)
    initial: tuple[float, ...] = parameter((0.0,), 'W_hat(0): one number, or one a node', unit='V')
    position_minimum: float = parameter(-6.0, 'first position centre', unit='um')
    position_maximum: float = parameter(6.0, 'last position centre', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity centre', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity centre', unit='um/s')
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
    maximum: float = parameter(1.0, 'largest magnitude of a weight, where projection is on', unit='V', minimum=0.0)

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
    gain: float = parameter(1.0, 'gamma_eta', unit='1/(V um)', minimum=0.0)
    leakage: float = parameter(0.1, 'sigma_eta, towards the initial widths', unit='V um/s', minimum=0.0)
    factor: float = parameter(3.0, 'the widths stay between the initial ones over and times this', above=1.0)


@dataclasses.dataclass(frozen=True)
class CompensatorParameters(ParameterSet):
    """Option beyond the thesis: a signed network over the reference learns the friction (docs/controllers.md)."""

    enabled: bool = parameter(False, 'whether the compensator takes part')
    nodes: int = parameter(5, 'nodes an axis', minimum=1, maximum=32, read_only=True)
    gain: float = parameter(1.0e-4, 'Gamma_c', unit='V/um', minimum=0.0)
    leakage: float = parameter(1.0e3, 'sigma_c', unit='um/(V s)', minimum=0.0)
    position_minimum: float = parameter(-3.0, 'first position centre', unit='um')
    position_maximum: float = parameter(3.0, 'last position centre', unit='um')
    velocity_minimum: float = parameter(-3000.0, 'first velocity centre', unit='um/s')
    velocity_maximum: float = parameter(3000.0, 'last velocity centre', unit='um/s')
    width: float = parameter(0.5, 'width in half ranges', above=0.0)
    advance: float = parameter(
        0.0,
        'time by which the inputs run ahead of the reference, along its velocity and acceleration',
        unit='s',
        minimum=0.0,
    )

    def check_together(self) -> None:
        """Check the ranges; raises :class:`ParameterError`."""
        _check_range('position_maximum', self.position_minimum, self.position_maximum)
        _check_range('velocity_maximum', self.velocity_minimum, self.velocity_maximum)


@dataclasses.dataclass(frozen=True)
class AdaptiveNnParameters(ParameterSet):
    """Parameters of :class:`AdaptiveNn`; the gains are those of ``studies/tune.py`` for the drive of chapter 5."""

    error_filter_lambda: float = parameter(595.0, 'lambda of (4.10)', unit='1/s', minimum=0.0)
    feedback_gain: float = parameter(7.7e-5, 'k of (4.16)', unit='V s/um', minimum=0.0)
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
    velocity_bandwidth: float = parameter(
        2000.0, 'corner frequency of the first-order low pass on the difference, 0 for none', unit='Hz', minimum=0.0
    )
    displacement_scale: float = parameter(
        8.0, 'displacement per volt of the sensor, as in the sensor', unit='um/V', above=0.0
    )
    velocity_scale: float = parameter(
        5000.0, 'velocity per volt of the sensor, as in the sensor', unit='um/s/V', above=0.0
    )
    integral_gain: float = parameter(
        0.0, "option beyond the thesis: lambda_i of r = e' + lambda e + lambda_i int e dt", unit='1/s^2', minimum=0.0
    )
    projection: bool = parameter(
        False, 'option beyond the thesis: whether the estimates are kept inside their minimum and maximum'
    )
    r_limit: float = parameter(
        0.0,
        'option beyond the thesis: r counts in the adaptation laws up to this magnitude, 0 for no limit',
        unit='um/s',
        minimum=0.0,
    )
    width: WidthParameters = group(WidthParameters)
    compensator: CompensatorParameters = group(CompensatorParameters)
    safe_gain: float = parameter(
        0.0,
        'largest linear gain on r that the loop is known to bear, 0 if not known; a warning says when '
        "k + 1/sigma_phi + max(S'S)/sigma_w exceeds it",
        unit='V s/um',
        minimum=0.0,
    )


def _check_bounds(minimum: float, maximum: float) -> None:
    if minimum > maximum:
        raise ParameterError('minimum', minimum, f'at most maximum = {maximum:g}')


def _check_range(name: str, minimum: float, maximum: float) -> None:
    if not maximum > minimum:
        raise ParameterError(name, maximum, f'above the minimum of its axis, {minimum:g}')


@compiled
def _adapted(constants: NDArray[np.float64], law: int, estimate: float, drive: float) -> float:
    """Return the next value of an estimate under one law: exact exponential, then its bounds."""
    value = constants[law + 1] * estimate + constants[law + 2] * drive
    if value < constants[law + 3]:
        return constants[law + 3]  # type: ignore[no-any-return]
    if value > constants[law + 4]:
        return constants[law + 4]  # type: ignore[no-any-return]
    return value  # type: ignore[no-any-return]


@compiled
def _tracking(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    position: float,
    velocity_volts: float,
    x_d: float,
    dx_d: float,
) -> tuple[float, float]:
    """Return the velocity [um/s] by the chosen source, and the reference velocity on the same path."""
    if constants[VELOCITY_SOURCE] == SENSOR:
        return velocity_volts * constants[VELOCITY_SCALE], dx_d
    velocity, reference = dx_d, dx_d
    if state[STARTED] != 0.0:
        smoothing = constants[SMOOTHING]
        velocity = state[MEASURED_VELOCITY]
        velocity += smoothing * ((position - state[LAST_POSITION]) / constants[TIME_STEP] - velocity)
        reference = state[REFERENCE_VELOCITY]
        reference += smoothing * ((x_d - state[LAST_REFERENCE]) / constants[TIME_STEP] - reference)
    state[STARTED] = 1.0
    state[LAST_POSITION] = position
    state[LAST_REFERENCE] = x_d
    state[MEASURED_VELOCITY] = velocity
    state[REFERENCE_VELOCITY] = reference
    return velocity, reference


@compiled
def _sign(r: float, boundary_layer: float) -> float:
    """Return sgn r with sgn 0 = 0, or r over the boundary layer inside of it."""
    if boundary_layer > 0.0:
        return max(-1.0, min(1.0, r / boundary_layer))
    if r > 0.0:
        return 1.0
    if r < 0.0:
        return -1.0
    return 0.0


@compiled
def _network_output(constants: NDArray[np.float64], state: NDArray[np.float64], x: float, v: float) -> float:
    """Fill the activations of the network and return W_hat'S."""
    n = int(constants[NODES])
    position_inverse = constants[POSITION_INVERSE]
    velocity_inverse = constants[VELOCITY_INVERSE]
    if constants[WIDTH_LAW] != 0.0:
        position_inverse *= exp(-2.0 * state[POSITION_WIDTH])
        velocity_inverse *= exp(-2.0 * state[VELOCITY_WIDTH])
    fill_axis(constants, CENTRES, n, position_inverse, x, state, ACTIVATIONS)
    fill_axis(constants, CENTRES + n, n, velocity_inverse, v, state, ACTIVATIONS + n)
    weights = ACTIVATIONS + 2 * n
    total = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += state[weights + i * n + j] * state[ACTIVATIONS + n + j]
        total += row * state[ACTIVATIONS + i]
    return total


@compiled
def _weight_norm(constants: NDArray[np.float64], state: NDArray[np.float64]) -> float:
    """Return the Euclidean norm of W_hat."""
    n = int(constants[NODES])
    total = 0.0
    for i in range(ACTIVATIONS + 2 * n, ACTIVATIONS + 2 * n + n * n):
        total += state[i] * state[i]
    return math.sqrt(total)


@compiled
def _adapt_widths(constants: NDArray[np.float64], state: NDArray[np.float64], x: float, v: float, r: float) -> None:
    """Adapt the logarithms of the widths relative to their initial ones; uses W_hat before its own adaptation."""
    n = int(constants[NODES])
    weights = ACTIVATIONS + 2 * n
    position_slope = 0.0
    velocity_slope = 0.0
    for i in range(n):
        row = 0.0
        row_slope = 0.0
        for j in range(n):
            s = state[weights + i * n + j] * state[ACTIVATIONS + n + j]
            distance = v - constants[CENTRES + n + j]
            row += s
            row_slope += s * distance * distance
        distance = x - constants[CENTRES + i]
        position_slope += row * state[ACTIVATIONS + i] * distance * distance
        velocity_slope += row_slope * state[ACTIVATIONS + i]
    theta = state[POSITION_WIDTH]
    slope = 2.0 * constants[POSITION_INVERSE] * exp(-2.0 * theta) * position_slope
    state[POSITION_WIDTH] = _adapted(constants, WIDTH_LAW, theta, slope * abs(r))
    theta = state[VELOCITY_WIDTH]
    slope = 2.0 * constants[VELOCITY_INVERSE] * exp(-2.0 * theta) * velocity_slope
    state[VELOCITY_WIDTH] = _adapted(constants, WIDTH_LAW, theta, slope * abs(r))


@compiled
def _adapt_weights(constants: NDArray[np.float64], state: NDArray[np.float64], r: float) -> None:
    """Adapt W_hat by (4.21)."""
    n = int(constants[NODES])
    weights = ACTIVATIONS + 2 * n
    decay = CENTRES + 2 * n
    step = decay + n * n
    limit = constants[WEIGHT_LIMIT]
    for i in range(n):
        drive = state[ACTIVATIONS + i] * abs(r)
        for j in range(n):
            at = i * n + j
            w = constants[decay + at] * state[weights + at]
            w += constants[step + at] * (drive * state[ACTIVATIONS + n + j])
            state[weights + at] = max(-limit, min(limit, w))


@compiled
def _compensator_output(
    constants: NDArray[np.float64], state: NDArray[np.float64], x_d: float, dx_d: float, ddx_d: float
) -> float:
    """Fill the activations of the compensator and return W_c'S_c of the reference."""
    n = int(constants[NODES])
    m = int(constants[COMPENSATOR_NODES])
    centres = CENTRES + 2 * n + 2 * n * n
    activations = ACTIVATIONS + 2 * n + n * n
    ahead = constants[COMPENSATOR_ADVANCE]
    x = x_d + ahead * dx_d
    v = dx_d + ahead * ddx_d
    fill_axis(constants, centres, m, constants[COMPENSATOR_POSITION], x, state, activations)
    fill_axis(constants, centres + m, m, constants[COMPENSATOR_VELOCITY], v, state, activations + m)
    weights = activations + 2 * m
    total = 0.0
    for i in range(m):
        row = 0.0
        for j in range(m):
            row += state[weights + i * m + j] * state[activations + m + j]
        total += row * state[activations + i]
    return total


@compiled
def _adapt_compensator(constants: NDArray[np.float64], state: NDArray[np.float64], r: float) -> None:
    """Adapt W_c' = -Gamma_c (S_c r + sigma_c W_c)."""
    n = int(constants[NODES])
    m = int(constants[COMPENSATOR_NODES])
    activations = ACTIVATIONS + 2 * n + n * n
    weights = activations + 2 * m
    for i in range(m):
        drive = -constants[COMPENSATOR_STEP] * r * state[activations + i]
        for j in range(m):
            at = weights + i * m + j
            state[at] = constants[COMPENSATOR_DECAY] * state[at] + drive * state[activations + m + j]


@compiled
def adaptive_nn_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    tick: int,
    displacement_volts: float,
    velocity_volts: float,
    x_d: float,
    dx_d: float,
    ddx_d: float,
) -> tuple[float, float, float]:
    """Return u, u before the limit and -k r [V]; see :class:`AdaptiveNn`."""
    if not all_finite(displacement_volts, velocity_volts, x_d, dx_d, ddx_d):
        return math.nan, math.nan, math.nan
    x = displacement_volts * constants[DISPLACEMENT_SCALE]
    v, reference_velocity = _tracking(constants, state, x, velocity_volts, x_d, dx_d)
    # (4.10), (4.11), with the integral of the option.
    e = x - x_d
    e_rate = v - reference_velocity
    integral = state[INTEGRAL] + constants[TIME_STEP] * e
    r = e_rate + constants[LAMBDA] * e + constants[INTEGRAL_GAIN] * integral
    a_r = ddx_d - constants[LAMBDA] * e_rate - constants[INTEGRAL_GAIN] * e
    # (4.16)
    feedback = -constants[FEEDBACK_GAIN] * r
    sign = _sign(r, constants[BOUNDARY_LAYER])
    u = feedback
    if constants[SIGMA_LAW] != 0.0:
        u += state[SIGMA] * v
    if constants[MASS_LAW] != 0.0:
        u += state[MASS] * a_r
    network = 0.0
    network_x, network_v = x, v
    if constants[NETWORK] != 0.0:
        if constants[NETWORK_INPUT] == REFERENCE:
            network_x, network_v = x_d, dx_d
        network = _network_output(constants, state, network_x, network_v)
        u -= network * sign
    if constants[PHI_LAW] != 0.0:
        u -= state[PHI] * sign
    compensator = 0.0
    if constants[COMPENSATOR] != 0.0:
        compensator = _compensator_output(constants, state, x_d, dx_d, ddx_d)
        u += compensator
    limited = saturated(u, constants[CONTROL_LIMIT])

    estimates[0] = float(tick) * constants[TIME_STEP]
    estimates[1] = r
    estimates[2] = state[SIGMA]
    estimates[3] = state[MASS]
    estimates[4] = state[PHI]
    estimates[5] = _weight_norm(constants, state)
    estimates[6] = e
    estimates[7] = network
    estimates[8] = integral
    estimates[9] = exp(state[POSITION_WIDTH]) / math.sqrt(constants[POSITION_INVERSE])
    estimates[10] = exp(state[VELOCITY_WIDTH]) / math.sqrt(constants[VELOCITY_INVERSE])
    estimates[11] = compensator

    if limited != u and constants[FREEZE] != 0.0:
        return limited, u, feedback
    state[INTEGRAL] = integral
    # (4.18)-(4.21)
    if constants[R_LIMIT] > 0.0:
        r = max(-constants[R_LIMIT], min(constants[R_LIMIT], r))
    if constants[SIGMA_LAW] != 0.0:
        state[SIGMA] = _adapted(constants, SIGMA_LAW, state[SIGMA], -v * r)
    if constants[MASS_LAW] != 0.0:
        state[MASS] = _adapted(constants, MASS_LAW, state[MASS], -a_r * r)
    if constants[PHI_LAW] != 0.0:
        state[PHI] = _adapted(constants, PHI_LAW, state[PHI], abs(r))
    if constants[NETWORK] != 0.0:
        if constants[WIDTH_LAW] != 0.0:
            _adapt_widths(constants, state, network_x, network_v, r)
        _adapt_weights(constants, state, r)
    if constants[COMPENSATOR] != 0.0:
        _adapt_compensator(constants, state, r)
    return limited, u, feedback


class AdaptiveNn:
    """
    The adaptive neural network controller of chapter 4.

    With e = x - x_d, v = dx/dt,

        r = e' + lambda e                              (4.10)
        a_r = x_d'' - lambda e'                        (4.11)
        u = -k r + sigma_hat v + m_hat a_r - W_hat'S(x, v) sgn r - phi_hat sgn r      (4.16)
        sigma_hat' = -k_sigma (v r + sigma_sigma sigma_hat)                           (4.18)
        m_hat' = -k_m (a_r r + sigma_m m_hat)                                         (4.19)
        phi_hat' = k_phi (|r| - sigma_phi phi_hat)              (4.20, corrected: the dot is missing in print)
        W_hat' = Gamma (S |r| - sigma_w W_hat)                  (4.21, corrected: the dot is missing in print)

    At tick k the control uses the estimates of tick k, which hold what was learnt up to tick k - 1; then the laws run
    over one sample with r, v, a_r and S held. They are linear in their own estimate, so this is done exactly (see
    :func:`~hdd_servo_ros.control.adaptation.decay_and_step`), which is stable for any constants that are not negative.

    Estimates: t [s]; r [um/s]; sigma_hat [V s/um]; m_hat [V s^2/um]; phi_hat [V]; norm of W_hat [V]; e [um]; the
    network's output W_hat'S [V]; integral of e [um s]; the lattice's widths [um], [um/s]; the compensator's output [V].

    Parameters
    ----------
    parameters
        Design constants. ``docs/controllers.md`` relates their names to the thesis's symbols.
    sample_time
        T [s].
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: AdaptiveNnParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.estimates: NDArray[np.float64] = np.zeros(len(ESTIMATE_NAMES))
        self._nodes = parameters.network.nodes
        self._compensator_nodes = parameters.compensator.nodes
        n, m = self._nodes, self._compensator_nodes
        self.state: NDArray[np.float64] = np.zeros(ACTIVATIONS + 2 * n + n * n + 2 * m + m * m)
        self.state[SIGMA] = parameters.sigma.initial
        self.state[MASS] = parameters.mass.initial
        self.state[PHI] = parameters.phi.initial
        self.weights[:] = parameters.network.initial
        self._take(parameters)

    @property
    def weights(self) -> NDArray[np.float64]:
        """W_hat [V], a view of shape (n n,), position index first."""
        start = ACTIVATIONS + 2 * self._nodes
        return self.state[start : start + self._nodes * self._nodes]

    @property
    def compensator_weights(self) -> NDArray[np.float64]:
        """W_c [V], a view of shape (m m,), position index first."""
        m = self._compensator_nodes
        return self.state[len(self.state) - m * m :]

    @property
    def gain_on_r(self) -> float:
        """
        The linear gain k + 1/sigma_phi + max(S'S)/sigma_w [V s/um] that the law comes to once its estimates follow |r|.

        A steady |r| ends in phi_hat = |r|/sigma_phi and W_hat = S |r|/sigma_w, and these multiply sgn r.
        """
        p = self.parameters
        gain = p.feedback_gain
        if p.phi.enabled and p.phi.gain > 0.0:
            gain += 1.0 / p.phi.leakage if p.phi.leakage > 0.0 else math.inf
        if p.network.enabled and max(p.network.gain) > 0.0:
            width = p.network.axis_widths
            squares = largest_square_sum(self._position_centres, width[0])
            squares *= largest_square_sum(self._velocity_centres, width[1])
            gain += squares / p.network.leakage if p.network.leakage > 0.0 else math.inf
        return gain

    def warnings(self) -> tuple[str, ...]:
        """Return what a user should be told of these constants before a run: nothing, or that the loop is fragile."""
        safe, gain = self.parameters.safe_gain, self.gain_on_r
        if safe > 0.0 and gain > safe:
            return (
                f"fragile constants: k + 1/sigma_phi + max(S'S)/sigma_w = {gain:.3g} V s/um acts as one linear gain on "
                f'r and exceeds safe_gain = {safe:.3g} V s/um; the loop may track at first and burst after seconds: '
                'raise phi.leakage or network.leakage, or lower feedback_gain',
            )
        return ()

    def update(self, parameters: AdaptiveNnParameters) -> None:
        """
        Take other parameters from the next tick on; what was learnt stays.

        Raises
        ------
        ParameterError
            If the number of nodes differs: the weights would have no meaning.
        """
        for name, new, old in (
            ('network.nodes', parameters.network.nodes, self._nodes),
            ('compensator.nodes', parameters.compensator.nodes, self._compensator_nodes),
        ):
            if new != old:
                raise ParameterError(name, new, f'fixed at {old} for this run')
        self._take(parameters)

    def _take(self, parameters: AdaptiveNnParameters) -> None:
        self.parameters = parameters
        network, compensator = parameters.network, parameters.compensator
        n, m = network.nodes, compensator.nodes
        self._position_centres = lattice(network.position_minimum, network.position_maximum, n)
        self._velocity_centres = lattice(network.velocity_minimum, network.velocity_maximum, n)
        constants = np.zeros(CENTRES + 2 * n + 2 * n * n + 2 * m)
        constants[TIME_STEP] = self.sample_time
        constants[DISPLACEMENT_SCALE] = parameters.displacement_scale
        constants[VELOCITY_SCALE] = parameters.velocity_scale
        constants[VELOCITY_SOURCE] = VELOCITY_SOURCES.index(parameters.velocity_source)
        constants[SMOOTHING] = 1.0
        if parameters.velocity_bandwidth > 0.0:
            constants[SMOOTHING] = 1.0 - exp(-TWO_PI * parameters.velocity_bandwidth * self.sample_time)
        constants[LAMBDA] = parameters.error_filter_lambda
        constants[INTEGRAL_GAIN] = parameters.integral_gain
        constants[FEEDBACK_GAIN] = parameters.feedback_gain
        constants[BOUNDARY_LAYER] = parameters.boundary_layer
        constants[CONTROL_LIMIT] = parameters.control_limit
        constants[FREEZE] = float(parameters.freeze_when_saturated)
        constants[R_LIMIT] = parameters.r_limit
        for law, group_ in ((SIGMA_LAW, parameters.sigma), (MASS_LAW, parameters.mass), (PHI_LAW, parameters.phi)):
            bounds = (group_.minimum, group_.maximum) if parameters.projection else (-math.inf, math.inf)
            self._set_law(constants, law, group_.enabled, group_.gain, group_.leakage, *bounds)
        width = parameters.width
        reach = log(width.factor)
        self._set_law(constants, WIDTH_LAW, width.enabled, width.gain, width.leakage, -reach, reach)
        constants[NETWORK] = float(network.enabled)
        constants[NODES] = n
        constants[NETWORK_INPUT] = NETWORK_INPUTS.index(network.input)
        position_width, velocity_width = network.axis_widths
        constants[POSITION_INVERSE] = 1.0 / (position_width * position_width)
        constants[VELOCITY_INVERSE] = 1.0 / (velocity_width * velocity_width)
        constants[WEIGHT_LIMIT] = network.maximum if parameters.projection else math.inf
        constants[CENTRES : CENTRES + n] = self._position_centres
        constants[CENTRES + n : CENTRES + 2 * n] = self._velocity_centres
        laws = [decay_and_step(gain, network.leakage, self.sample_time) for gain in network.gain]
        decay = CENTRES + 2 * n
        constants[decay : decay + n * n] = [law[0] for law in laws] if len(laws) > 1 else laws[0][0]
        constants[decay + n * n : decay + 2 * n * n] = [law[1] for law in laws] if len(laws) > 1 else laws[0][1]
        constants[COMPENSATOR] = float(compensator.enabled)
        constants[COMPENSATOR_NODES] = m
        half = 0.5 * compensator.width * (compensator.position_maximum - compensator.position_minimum)
        constants[COMPENSATOR_POSITION] = 1.0 / (half * half)
        half = 0.5 * compensator.width * (compensator.velocity_maximum - compensator.velocity_minimum)
        constants[COMPENSATOR_VELOCITY] = 1.0 / (half * half)
        a, b = decay_and_step(compensator.gain, compensator.leakage, self.sample_time)
        constants[COMPENSATOR_DECAY], constants[COMPENSATOR_STEP] = a, b
        constants[COMPENSATOR_ADVANCE] = compensator.advance
        centres = CENTRES + 2 * n + 2 * n * n
        constants[centres : centres + m] = lattice(compensator.position_minimum, compensator.position_maximum, m)
        constants[centres + m :] = lattice(compensator.velocity_minimum, compensator.velocity_maximum, m)
        self.constants: NDArray[np.float64] = constants

    def _set_law(
        self,
        constants: NDArray[np.float64],
        law: int,
        enabled: bool,
        gain: float,
        leakage: float,
        minimum: float,
        maximum: float,
    ) -> None:
        constants[law] = float(enabled)
        constants[law + 1], constants[law + 2] = decay_and_step(gain, leakage, self.sample_time)
        constants[law + 3] = minimum
        constants[law + 4] = maximum

    def step(
        self, tick: int, displacement_volts: float, velocity_volts: float, x_d: float, dx_d: float, ddx_d: float
    ) -> tuple[float, float, float]:
        """Return u, u before the limit, and its feedback part -k r [V]; see :class:`Controller`."""
        return adaptive_nn_step(
            self.constants, self.state, self.estimates, tick, displacement_volts, velocity_volts, x_d, dx_d, ddx_d
        )
