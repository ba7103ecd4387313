"""The compiled step of the adaptive neural network controller, (4.10)-(4.21)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.adaptive_nn_parameters import NETWORK_INPUTS, VELOCITY_SOURCES
from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.control.input_shaping import STATE_SIZE, shaped
from hdd_servo_ros.control.rbf import fill_axis, lattice_sum
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp

SENSOR = VELOCITY_SOURCES.index('sensor')
REFERENCE = NETWORK_INPUTS.index('reference')

# Where the constants of adaptive_nn_step stand. A law has five: switch, a, b, smallest and largest estimate.
TIME_STEP, VELOCITY_SOURCE, SMOOTHING, _UNUSED_1, _UNUSED_2 = range(5)
LAMBDA, INTEGRAL_GAIN, FEEDBACK_GAIN, BOUNDARY_LAYER, CONTROL_LIMIT, FREEZE, R_LIMIT = range(5, 12)
LAW_SIZE = 5
SIGMA_LAW, MASS_LAW, PHI_LAW, WIDTH_LAW = range(12, 12 + 4 * LAW_SIZE, LAW_SIZE)
NETWORK, NODES, NETWORK_INPUT, POSITION_INVERSE, VELOCITY_INVERSE, WEIGHT_LIMIT = range(32, 38)
COMPENSATOR, COMPENSATOR_NODES, COMPENSATOR_POSITION, COMPENSATOR_VELOCITY = range(38, 42)
COMPENSATOR_DECAY, COMPENSATOR_STEP, COMPENSATOR_LAG, FILTER_REFERENCE = range(42, 46)
SHAPING_SHARE, SHAPING_TICKS = range(46, 48)
CENTRES = 48
# From CENTRES on: n position and n velocity centres, n^2 decays and n^2 steps of W, then the compensator's centres.

# Where its state stands; then n + n activations, n^2 weights, and the same of the compensator.
SIGMA, MASS, PHI, POSITION_WIDTH, VELOCITY_WIDTH, INTEGRAL = range(6)
LAST_POSITION, LAST_REFERENCE, MEASURED_VELOCITY, REFERENCE_VELOCITY, STARTED = range(6, 11)
SHAPING = 11
ACTIVATIONS = SHAPING + STATE_SIZE


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
    measured_velocity: float,
    x_d: float,
    dx_d: float,
) -> tuple[float, float]:
    """Return the velocity [um/s] by the chosen source, and the reference velocity on the same path."""
    if constants[VELOCITY_SOURCE] == SENSOR:
        return measured_velocity, dx_d
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
    if constants[FILTER_REFERENCE] == 0.0:
        return velocity, dx_d
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
    return lattice_sum(state, ACTIVATIONS + 2 * n, ACTIVATIONS, n)


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
def _activate_compensator(constants: NDArray[np.float64], state: NDArray[np.float64], x_d: float, dx_d: float) -> None:
    """Fill the compensator's activations S_c at a point of the reference."""
    n = int(constants[NODES])
    m = int(constants[COMPENSATOR_NODES])
    centres = CENTRES + 2 * n + 2 * n * n
    activations = ACTIVATIONS + 2 * n + n * n
    fill_axis(constants, centres, m, constants[COMPENSATOR_POSITION], x_d, state, activations)
    fill_axis(constants, centres + m, m, constants[COMPENSATOR_VELOCITY], dx_d, state, activations + m)


@compiled
def _compensator_output(constants: NDArray[np.float64], state: NDArray[np.float64]) -> float:
    """Return W_c'S_c."""
    n = int(constants[NODES])
    m = int(constants[COMPENSATOR_NODES])
    activations = ACTIVATIONS + 2 * n + n * n
    return lattice_sum(state, activations + 2 * m, activations, m)


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
    *values: Any,
) -> tuple[float, float, float]:
    """Return u, u before the limit and -k r [V]; see :class:`AdaptiveNn`."""
    inputs = ControllerInputs(*values)
    if not all_finite(inputs):
        return math.nan, math.nan, math.nan
    x = inputs.position
    dx_d, ddx_d = inputs.desired_velocity, inputs.desired_acceleration
    x_d = shaped(state, SHAPING, inputs.desired_position, dx_d, constants[SHAPING_SHARE], constants[SHAPING_TICKS])
    v, reference_velocity = _tracking(constants, state, x, inputs.velocity, x_d, dx_d)
    # (4.10), (4.11), with the integral of the option.
    e = x - x_d
    e_rate = v - reference_velocity
    integral = state[INTEGRAL]
    if constants[INTEGRAL_GAIN] > 0.0:
        integral += constants[TIME_STEP] * e
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
        _activate_compensator(constants, state, x_d, dx_d)
        compensator = _compensator_output(constants, state)
        u += compensator
    limited = saturated(u, constants[CONTROL_LIMIT])

    estimates[0] = float(inputs.tick) * constants[TIME_STEP]
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
        lag = constants[COMPENSATOR_LAG]
        if lag > 0.0:
            # r answers to what the compensator did a lag ago.
            _activate_compensator(constants, state, x_d - lag * dx_d, dx_d - lag * ddx_d)
        _adapt_compensator(constants, state, r)
    return limited, u, feedback
