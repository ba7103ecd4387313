"""
LuGre friction model, thesis eqs. (2.20)-(2.22), and its position-dependent form with alpha(x, v), eqs. (2.23)-(2.24).

The bristle equation is stiff: its rate sigma_0 ``|v|`` / g(v) reaches 5e5 s^-1 in thesis section 5.4. Over one substep
of length D the mean velocity w is held, so the bristle equation is linear and has the exact solution::

    z(D) = z e^(-X) + w D p1(X),    integral of z = z D p1(X) + w D^2 p2(X),    X = D sigma_0 |w| / g(w),

with p1(X) = (1 - e^(-X)) / X and p2(X) = (1 - p1) / X. The momentum equation, written in impulses, is linear in w too.
Only X needs w in advance, and uses its prediction from the friction of the previous substep. The step is of second
order and bounded for any stiffness. The deflection is limited to f_s/sigma_0, the bound of lemma 4.1.

The prediction fails where sigma_1 stops the body within one or two substeps: with a wrong X the contact can return more
energy than it stores. In that case X and w are solved for together, and the step is as passive as the model.
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.parameters import FrictionModel
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp, sine_cosine_of_turns

STRONG_DAMPING = 0.5
"""Value of D sigma_1/m above which the friction of the previous substep no longer predicts the velocity."""
PASSES = 100
"""Maximum number of iterations for the mean velocity of such a substep; ten suffice on average."""
TOLERANCE = 1.0e-13
"""Relative change of the mean velocity that ends the iteration."""


@compiled
def decay_functions(x: float) -> tuple[float, float]:
    """Return p1 = (1 - exp(-x)) / x and p2 = (1 - p1) / x for x >= 0, without cancellation near zero."""
    if x < 0.05:
        square = x * x
        # Taylor series up to x^5; the first omitted term is below 4e-13.
        p2 = (0.5 - x * 0.16666666666666666) + square * (
            (0.041666666666666664 - x * 0.008333333333333333)
            + square * (0.001388888888888889 - x * 0.0001984126984126984)
        )
        return 1.0 - x * p2, p2
    p1 = (1.0 - exp(-x)) / x
    return p1, (1.0 - p1) / x


@compiled
def lugre_level(friction: np.record, position: float, velocity: float) -> float:
    """
    Return the Stribeck curve g(v) = f_c + (f_s - f_c) exp(-(v/v_s)^2) [V]; alpha(v) = sigma_0 / g(v), eq. (2.22).

    The model ``lugre_position`` uses g(v) (1 + e sin(2 pi x/p)), so that alpha(x, v) of eq. (2.24) is positive and
    bounded for e < 1. The other models ignore the position.
    """
    ratio = velocity * friction.inverse_stribeck_velocity
    level: float = friction.coulomb_level + (friction.static_level - friction.coulomb_level) * exp(-ratio * ratio)
    if int(friction.model) == FrictionModel.LUGRE_POSITION:
        turns = position * friction.inverse_position_period
        level *= 1.0 + friction.position_ripple * sine_cosine_of_turns(turns)[0]
    return level


@compiled
def lugre_friction(friction: np.record, position: float, velocity: float, bristle: float) -> float:
    """Return the friction of eq. (2.20) [V] at a position [um], a velocity [um/s] and a bristle deflection [um]."""
    stiffness: float = friction.stiffness
    level = lugre_level(friction, position, velocity)
    rate = velocity - stiffness * abs(velocity) / level * bristle
    result: float = stiffness * bristle + friction.bristle_damping * rate + friction.viscous_coefficient * velocity
    return result


@compiled
def lugre_bristle(
    substep: float, mean_velocity: float, bristle: float, stiffness: float, level: float
) -> tuple[float, float]:
    """
    Return the bristle deflection after a substep at constant velocity, and its mean over the substep [um].

    This is the exact solution of eq. (2.21) for a given motion; the plant step contains it inline.
    """
    decay_1, decay_2 = decay_functions(substep * stiffness * abs(mean_velocity) / level)
    mean = bristle * decay_1 + mean_velocity * substep * decay_2
    return bristle + substep * mean_velocity - substep * stiffness * abs(mean_velocity) / level * mean, mean


@compiled
def lugre_substep(
    friction: np.record,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    bristle: float,
    previous_force: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with LuGre friction by one substep.

    For the arguments see :func:`~hdd_servo_ros.drive.friction.static.static_substep`; in addition, ``bristle`` is the
    bristle deflection z at the start [um], and ``previous_force`` is the mean friction of the previous substep [V],
    which predicts the mean velocity.

    Returns
    -------
    tuple
        Mean velocity w [um/s] (the velocity at the end is 2 w - v), deflection at the end [um], mean friction [V].
    """
    stiffness = friction.stiffness
    damping = friction.bristle_damping
    limit = friction.bristle_limit
    if gain * substep * damping > STRONG_DAMPING:
        return _strongly_damped_substep(friction, substep, gain, position, velocity, bristle, applied, drag)
    mean = velocity + 0.5 * substep * gain * (applied - previous_force - drag * velocity)
    level = lugre_level(friction, position + 0.5 * substep * velocity, mean)
    rate = stiffness * abs(mean) / level
    decay_1, decay_2 = decay_functions(substep * rate)
    relaxation = bristle * rate * decay_1
    held = stiffness * bristle * decay_1 - damping * relaxation
    spring = substep * stiffness * decay_2
    resistance = spring + damping * decay_1 + friction.viscous_coefficient
    mean = (2.0 * velocity + gain * substep * (applied - held)) / (2.0 + gain * substep * (resistance + drag))
    force = held + resistance * mean
    return mean, min(max(bristle + substep * (mean * decay_1 - relaxation), -limit), limit), force


@compiled_apart
def _strongly_damped_substep(
    friction: np.record,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    bristle: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float]:
    """
    Advance a body whose velocity the bristle damping changes too fast for a prediction; see :func:`lugre_substep`.

    The residual of the momentum equation is continuous in the mean velocity. At zero velocity it has the sign of the
    force on a body at rest, and it has the opposite sign at a velocity that follows from the deflection limit. The
    Illinois variant of the false position method finds the root between them.
    """
    stiffness = friction.stiffness
    damping = friction.bristle_damping
    limit = friction.bristle_limit
    impulse = gain * substep
    middle = position + 0.5 * substep * velocity
    low, residual_at_low = 0.0, 2.0 * velocity + impulse * (applied - stiffness * bristle)
    reach = abs(velocity) + 0.5 * impulse * (abs(applied) + (stiffness + damping / substep) * limit)
    high = math.copysign(reach, residual_at_low)
    residual_at_high = _momentum_residual(friction, substep, gain, middle, velocity, bristle, applied, drag, high)
    mean, side = 0.0, 0
    for _ in range(PASSES):
        before = mean
        mean = (low * residual_at_high - high * residual_at_low) / (residual_at_high - residual_at_low)
        residual = _momentum_residual(friction, substep, gain, middle, velocity, bristle, applied, drag, mean)
        if residual == 0.0 or abs(mean - before) <= TOLERANCE * abs(mean):
            break
        # An end that is kept for the second time gets half its residual; otherwise it might never move.
        if residual * residual_at_low > 0.0:
            low, residual_at_low = mean, residual
            if side == 1:
                residual_at_high *= 0.5
            side = 1
        else:
            high, residual_at_high = mean, residual
            if side == -1:
                residual_at_low *= 0.5
            side = -1
    end, _ = lugre_bristle(substep, mean, bristle, stiffness, lugre_level(friction, middle, mean))
    return mean, min(max(end, -limit), limit), applied - drag * mean - 2.0 * (mean - velocity) / impulse


@compiled_apart
def _momentum_residual(
    friction: np.record,
    substep: float,
    gain: float,
    middle: float,
    velocity: float,
    bristle: float,
    applied: float,
    drag: float,
    mean: float,
) -> float:
    """Return the residual of the momentum equation of a substep for a mean velocity, as a doubled velocity [um/s]."""
    stiffness = friction.stiffness
    end, deflection = lugre_bristle(substep, mean, bristle, stiffness, lugre_level(friction, middle, mean))
    force = stiffness * deflection + friction.bristle_damping * (end - bristle) / substep
    force += friction.viscous_coefficient * mean
    residual: float = 2.0 * (velocity - mean) + gain * substep * (applied - force - drag * mean)
    return residual
