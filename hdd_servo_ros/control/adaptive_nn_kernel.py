"""Compiled step of the adaptive neural network controller, thesis eqs. (4.10)-(4.21)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.control.desired_compensation import (
    ACCELERATION,
    DESIRED,
    DESIRED_STATE,
    HYSTERESIS,
    RELAXATION,
    SPRING,
    VELOCITY,
    advance,
    learning_signal,
)
from hdd_servo_ros.control.input_shaping import SHAPING_STATE, shaped
from hdd_servo_ros.control.rbf import activate, lattice_sum
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.numerics.records import layout, record

# One adaptation law: enabled or not, a and b of decay_and_step, smallest and largest estimate, and 1/s^2 for the
# normalized laws of desired compensation.
LAW = layout('enabled', 'decay', 'step', 'minimum', 'maximum', 'normalization')

# Adaptation law of one network weight; all weights share their bounds.
WEIGHT_LAW = layout('decay', 'step')

NETWORK = layout('enabled', 'reads_reference', 'position_inverse_square', 'velocity_inverse_square', 'weight_limit')

COMPENSATOR = layout(
    'enabled', 'position_inverse_square', 'velocity_inverse_square', 'decay', 'step', 'lag', 'weight_limit'
)

CONSTANTS = layout(
    'time_step',
    'uses_difference',
    'filters_reference',
    'smoothing',
    'shaping_share',
    'shaping_ticks',
    'error_filter_lambda',
    'integral_gain',
    'feedback_gain',
    'boundary_layer',
    'control_limit',
    'freezes_when_saturated',
    'r_limit',
    ('sigma', LAW),
    ('mass', LAW),
    ('phi', LAW),
    ('width', LAW),
    ('desired', DESIRED),
    ('spring', LAW),
    ('hysteresis', LAW),
    ('relaxation', LAW),
    ('network', NETWORK),
    ('compensator', COMPENSATOR),
)

STATE = layout(
    'sigma_hat',
    'm_hat',
    'phi_hat',
    'spring_hat',
    'hysteresis_hat',
    'relaxation_hat',
    'log_position_width',
    'log_velocity_width',
    'integral',
    'last_position',
    'last_reference',
    'measured_velocity',
    'reference_velocity',
    'started',
    ('shaping', SHAPING_STATE),
    ('desired', DESIRED_STATE),
)

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
    'spring_hat',
    'hysteresis_hat',
    'relaxation_hat',
    'bristles',
)
ESTIMATES = layout(*ESTIMATE_NAMES)


@compiled
def _adapted(law: Any, estimate: float, drive: float) -> float:
    """Return the next value of an estimate: exact exponential step, then projection onto its bounds."""
    value: float = law.decay * estimate + law.step * drive
    if value < law.minimum:
        return law.minimum  # type: ignore[no-any-return]
    if value > law.maximum:
        return law.maximum  # type: ignore[no-any-return]
    return value


@compiled
def _tracking(c: Any, s: Any, inputs: ControllerInputs, x_d: float) -> tuple[float, float]:
    """Return the velocity [um/s] from the chosen source, and the reference velocity through the same filter."""
    x, dx_d = inputs.position, inputs.desired_velocity
    if c.uses_difference == 0.0:
        return inputs.velocity, dx_d
    velocity, reference = dx_d, dx_d
    if s.started != 0.0:
        velocity = s.measured_velocity
        velocity += c.smoothing * ((x - s.last_position) / c.time_step - velocity)
        reference = s.reference_velocity
        reference += c.smoothing * ((x_d - s.last_reference) / c.time_step - reference)
    s.started = 1.0
    s.last_position = x
    s.last_reference = x_d
    s.measured_velocity = velocity
    s.reference_velocity = reference
    if c.filters_reference == 0.0:
        return velocity, dx_d
    return velocity, reference


@compiled
def _sign(r: float, boundary_layer: float) -> float:
    """Return sgn r with sgn 0 = 0, linear inside the boundary layer."""
    if boundary_layer > 0.0:
        return max(-1.0, min(1.0, r / boundary_layer))
    # No branch: the sign of r is noise, which no branch predictor can predict.
    return (1.0 if r > 0.0 else 0.0) - (1.0 if r < 0.0 else 0.0)


@compiled
def _activate_network(
    c: Any, s: Any, centers: NDArray[np.float64], x: float, v: float, activations: NDArray[np.float64]
) -> None:
    """Compute the network activations S for the present widths."""
    position_inverse_square = c.network.position_inverse_square
    velocity_inverse_square = c.network.velocity_inverse_square
    if c.width.enabled != 0.0:
        position_inverse_square *= exp(-2.0 * s.log_position_width)
        velocity_inverse_square *= exp(-2.0 * s.log_velocity_width)
    activate(centers, position_inverse_square, velocity_inverse_square, x, v, activations)


@compiled
def _width(log_width: float, inverse_square: float) -> float:
    """Return the width eta from the logarithm of its ratio to the initial width, which is given as 1/eta^2."""
    initial = math.sqrt(inverse_square)
    # Fixed widths need no exponential.
    return 1.0 / initial if log_width == 0.0 else exp(log_width) / initial


@compiled
def _norm(weights: NDArray[np.float64]) -> float:
    """Return the Euclidean norm of W_hat."""
    n = len(weights)
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += weights[i, j] * weights[i, j]
    return math.sqrt(total)


@compiled_apart
def _adapt_widths(
    c: Any,
    s: Any,
    centers: NDArray[np.float64],
    activations: NDArray[np.float64],
    weights: NDArray[np.float64],
    x: float,
    v: float,
    r: float,
) -> None:
    """Adapt the logarithms of the widths relative to the initial ones; uses W_hat before its own adaptation."""
    n = len(weights)
    position_slope = 0.0
    velocity_slope = 0.0
    for i in range(n):
        row = 0.0
        row_slope = 0.0
        for j in range(n):
            term = weights[i, j] * activations[1, j]
            distance = v - centers[1, j]
            row += term
            row_slope += term * distance * distance
        distance = x - centers[0, i]
        position_slope += row * activations[0, i] * distance * distance
        velocity_slope += row_slope * activations[0, i]
    theta = s.log_position_width
    slope = 2.0 * c.network.position_inverse_square * exp(-2.0 * theta) * position_slope
    s.log_position_width = _adapted(c.width, theta, slope * abs(r))
    theta = s.log_velocity_width
    slope = 2.0 * c.network.velocity_inverse_square * exp(-2.0 * theta) * velocity_slope
    s.log_velocity_width = _adapted(c.width, theta, slope * abs(r))


@compiled
def _adapt_weights(
    laws: NDArray[np.float64],
    limit: float,
    activations: NDArray[np.float64],
    weights: NDArray[np.float64],
    r: float,
) -> None:
    """Adapt W_hat by thesis eq. (4.21)."""
    n = len(weights)
    for i in range(n):
        drive = activations[0, i] * abs(r)
        for j in range(n):
            law = record(laws, WEIGHT_LAW, i * n + j)
            w = law.decay * weights[i, j]
            w += law.step * (drive * activations[1, j])
            weights[i, j] = max(-limit, min(limit, w))


@compiled
def _adapt_compensator(law: Any, activations: NDArray[np.float64], weights: NDArray[np.float64], r: float) -> None:
    """Adapt W_c' = -Gamma_c (S_c r + sigma_c W_c)."""
    m = len(weights)
    limit = law.weight_limit
    for i in range(m):
        drive = -law.step * r * activations[0, i]
        for j in range(m):
            w = law.decay * weights[i, j] + drive * activations[1, j]
            weights[i, j] = max(-limit, min(limit, w))


@compiled
def _adapt_desired(c: Any, s: Any, regressors: NDArray[np.float64], r: float) -> None:
    """Adapt sigma_hat, m_hat and the bristle friction with the delayed regressors, shape (5,)."""
    peaks = s.desired.peaks
    if c.sigma.enabled != 0.0:
        drive = learning_signal(c.sigma, peaks.velocity, regressors[VELOCITY], r)
        s.sigma_hat = _adapted(c.sigma, s.sigma_hat, drive)
    if c.mass.enabled != 0.0:
        drive = learning_signal(c.mass, peaks.acceleration, regressors[ACCELERATION], r)
        s.m_hat = _adapted(c.mass, s.m_hat, drive)
    if c.desired.has_bristles != 0.0:
        drive = learning_signal(c.spring, peaks.spring, regressors[SPRING], r)
        s.spring_hat = _adapted(c.spring, s.spring_hat, drive)
        drive = learning_signal(c.hysteresis, peaks.hysteresis, regressors[HYSTERESIS], r)
        s.hysteresis_hat = _adapted(c.hysteresis, s.hysteresis_hat, drive)
        drive = learning_signal(c.relaxation, peaks.relaxation, regressors[RELAXATION], r)
        s.relaxation_hat = _adapted(c.relaxation, s.relaxation_hat, drive)


@compiled
def adaptive_nn_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    centers: NDArray[np.float64],
    weight_laws: NDArray[np.float64],
    activations: NDArray[np.float64],
    weights: NDArray[np.float64],
    compensator_centers: NDArray[np.float64],
    compensator_activations: NDArray[np.float64],
    compensator_weights: NDArray[np.float64],
    history: NDArray[np.float64],
    estimates: NDArray[np.float64],
    *values: Any,
) -> tuple[float, float, float]:
    """
    Return u, u before the limit, and its feedback part -k r [V]; see :class:`AdaptiveNn`.

    Parameters
    ----------
    constants, state, estimates
        Records ``CONSTANTS``, ``STATE`` and ``ESTIMATES``.
    centers, activations
        Centers and activations of the n x n network: position axis first, then velocity axis, shape (2, n).
    weight_laws
        ``WEIGHT_LAW`` of each node, shape (n n, 2).
    weights
        W_hat [V], shape (n, n), position index first.
    compensator_centers, compensator_activations, compensator_weights
        The same arrays of the m x m compensator.
    history
        Regressors of desired compensation, shape (ticks of its lag + 1, 5); see
        :func:`~hdd_servo_ros.control.desired_compensation.advance`.
    *values
        The fields of :class:`ControllerInputs`.
    """
    inputs = ControllerInputs(*values)
    if not all_finite(inputs):
        return math.nan, math.nan, math.nan
    c, s = record(constants, CONSTANTS), record(state, STATE)
    x = inputs.position
    dx_d, ddx_d = inputs.desired_velocity, inputs.desired_acceleration
    x_d = shaped(s.shaping, inputs.desired_position, dx_d, c.shaping_share, c.shaping_ticks)
    v, reference_velocity = _tracking(c, s, inputs, x_d)
    # (4.10) and (4.11), with the optional integral term.
    lambda_, lambda_i = c.error_filter_lambda, c.integral_gain
    e = x - x_d
    e_rate = v - reference_velocity
    integral = s.integral
    if lambda_i > 0.0:
        integral += c.time_step * e
    r = e_rate + lambda_ * e + lambda_i * integral
    a_r = ddx_d - lambda_ * e_rate - lambda_i * e
    # Regressors of sigma_hat and m_hat: those of (4.16), or those of the reference.
    velocity_regressor, acceleration_regressor = v, a_r
    row = 0
    is_desired = c.desired.enabled != 0.0
    if is_desired:
        row = advance(c.desired, s.desired, x_d, dx_d, ddx_d, history)
        velocity_regressor, acceleration_regressor = dx_d, ddx_d
    # (4.16)
    feedback = -c.feedback_gain * r
    sign = _sign(r, c.boundary_layer)
    u = feedback
    if c.sigma.enabled != 0.0:
        u += s.sigma_hat * velocity_regressor
    if c.mass.enabled != 0.0:
        u += s.m_hat * acceleration_regressor
    network = 0.0
    network_x, network_v = x, v
    if c.network.enabled != 0.0:
        if c.network.reads_reference != 0.0:
            network_x, network_v = x_d, dx_d
        _activate_network(c, s, centers, network_x, network_v, activations)
        network = lattice_sum(weights, activations)
        u -= network * sign
    if c.phi.enabled != 0.0:
        u -= s.phi_hat * sign
    bristles = 0.0
    if is_desired and c.desired.has_bristles != 0.0:
        bristles = s.spring_hat * history[row, SPRING]
        bristles += s.hysteresis_hat * history[row, HYSTERESIS]
        bristles += s.relaxation_hat * history[row, RELAXATION]
        u += bristles
    compensator = 0.0
    own = c.compensator
    if own.enabled != 0.0:
        activate(
            compensator_centers,
            own.position_inverse_square,
            own.velocity_inverse_square,
            x_d,
            dx_d,
            compensator_activations,
        )
        compensator = lattice_sum(compensator_weights, compensator_activations)
        u += compensator
    limited = saturated(u, c.control_limit)

    found = record(estimates, ESTIMATES)
    found.t = float(inputs.tick) * c.time_step
    found.r = r
    found.sigma_hat = s.sigma_hat
    found.m_hat = s.m_hat
    found.phi_hat = s.phi_hat
    found.W_norm = _norm(weights)
    found.e = e
    found.network = network
    found.integral = integral
    found.position_width = _width(s.log_position_width, c.network.position_inverse_square)
    found.velocity_width = _width(s.log_velocity_width, c.network.velocity_inverse_square)
    found.compensator = compensator
    found.spring_hat = s.spring_hat
    found.hysteresis_hat = s.hysteresis_hat
    found.relaxation_hat = s.relaxation_hat
    found.bristles = bristles

    if limited != u and c.freezes_when_saturated != 0.0:
        return limited, u, feedback
    s.integral = integral
    if c.r_limit > 0.0:
        r = max(-c.r_limit, min(c.r_limit, r))
    # (4.18)-(4.21)
    if is_desired:
        # A constant reference does not excite the laws; the integral alone removes the rest of a step's error.
        if dx_d != 0.0 or ddx_d != 0.0:
            _adapt_desired(c, s, history[(row + 1) % len(history)], r)
    else:
        if c.sigma.enabled != 0.0:
            s.sigma_hat = _adapted(c.sigma, s.sigma_hat, -v * r)
        if c.mass.enabled != 0.0:
            s.m_hat = _adapted(c.mass, s.m_hat, -a_r * r)
    if c.phi.enabled != 0.0:
        s.phi_hat = _adapted(c.phi, s.phi_hat, abs(r))
    if c.network.enabled != 0.0:
        if c.width.enabled != 0.0:
            _adapt_widths(c, s, centers, activations, weights, network_x, network_v, r)
        _adapt_weights(weight_laws, c.network.weight_limit, activations, weights, r)
    if own.enabled != 0.0:
        if own.lag > 0.0:
            # r responds to the compensator output one lag later.
            activate(
                compensator_centers,
                own.position_inverse_square,
                own.velocity_inverse_square,
                x_d - own.lag * dx_d,
                dx_d - own.lag * ddx_d,
                compensator_activations,
            )
        _adapt_compensator(own, compensator_activations, compensator_weights, r)
    return limited, u, feedback
