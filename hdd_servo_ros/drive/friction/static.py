"""
Static friction models, thesis eqs. (2.1), (2.3)-(2.13): functions of velocity only; their step has a Karnopp dead band.

Each model is a dry friction in the direction of motion plus a viscous term,
``F = level(|v|) sgn v + resistance(|v|) v``. The thesis equations have this form once their misprints are corrected: in
(2.6)-(2.10) and (2.12) the Stribeck term lacks sgn v, in (2.6) and (2.11) the velocity lacks its absolute value, and
(2.9) prints the first offset twice.
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.parameters import FrictionModel
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp, log


@compiled_apart
def power(base: float, exponent: float) -> float:
    """Return ``base`` ** ``exponent`` for base >= 0 and exponent > 0."""
    if base < 1.0e-300:
        return 0.0
    return exp(exponent * log(base))


@compiled
def gaussian(ratio: float) -> float:
    """Return exp(-ratio^2), the Stribeck term of eqs. (2.7)-(2.9) and (2.22)."""
    return exp(-ratio * ratio)


@compiled
def lorentzian(ratio: float) -> float:
    """Return 1 / (1 + ratio^2), the Stribeck term of eq. (2.12)."""
    return 1.0 / (1.0 + ratio * ratio)


@compiled_apart
def stribeck_level(friction: np.record, speed: float) -> float:
    """
    Return the dry friction of the Stribeck models, eqs. (2.6)-(2.10) and (2.12), at a speed ``|v|`` [um/s], in V.

    It decreases from f_s to f_c; the height of the first Stribeck term is f_s1 = f_s - f_c.
    """
    model = int(friction.model)
    coulomb: float = friction.coulomb_level
    first_height: float = friction.static_level - coulomb
    second_height: float = friction.second_break_level
    first = speed
    second = speed
    if model in (FrictionModel.GAUSSIAN_TWO_BREAKS_OFFSETS, FrictionModel.LORENTZIAN_TWO_BREAKS_OFFSETS):
        first -= friction.first_offset_velocity
        second -= friction.second_offset_velocity
    first *= friction.inverse_stribeck_velocity
    second *= friction.inverse_second_stribeck_velocity
    if model == FrictionModel.GAUSSIAN:
        return coulomb + first_height * gaussian(first)
    if model in (FrictionModel.GAUSSIAN_TWO_BREAKS, FrictionModel.GAUSSIAN_TWO_BREAKS_OFFSETS):
        return coulomb + first_height * gaussian(first) + second_height * gaussian(second)
    if model == FrictionModel.LORENTZIAN:
        return coulomb + first_height * lorentzian(first)
    if model in (FrictionModel.LORENTZIAN_TWO_BREAKS, FrictionModel.LORENTZIAN_TWO_BREAKS_OFFSETS):
        return coulomb + first_height * lorentzian(first) + second_height * lorentzian(second)
    if model == FrictionModel.TUSTIN:
        return coulomb + first_height * exp(-first)
    return coulomb + first_height * exp(-power(first, friction.stribeck_exponent))


@compiled
def sliding_terms(friction: np.record, speed: float) -> tuple[float, float]:
    """
    Return dry friction [V] and viscous damping [V s/um] in sliding: F = level sgn v + resistance v.

    Parameters
    ----------
    friction
        Record with the layout :data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`.
    speed
        Speed ``|v|`` [um/s].
    """
    model = int(friction.model)
    viscous = friction.viscous_coefficient
    if model == FrictionModel.STICTION:
        return 0.0, 0.0
    if model == FrictionModel.COULOMB:
        return friction.coulomb_level, 0.0
    if model == FrictionModel.VISCOUS:
        return 0.0, viscous
    if model == FrictionModel.COULOMB_VISCOUS:
        return friction.coulomb_level, viscous
    if model == FrictionModel.DRAG:
        return 0.0, friction.drag_coefficient * speed
    if model in (FrictionModel.SQUARE_ROOT, FrictionModel.COMPLETE):
        level: float = friction.coulomb_level + friction.square_root_coefficient * math.sqrt(speed)
        resistance: float = viscous
        if model == FrictionModel.COMPLETE:
            resistance += friction.drag_coefficient * speed
        if level < 0.0:
            # f_r < 0: the total is not negative, but a negative dry friction would drive a body that changes speed.
            return 0.0, level / speed + resistance
        return level, resistance
    return stribeck_level(friction, speed), viscous


@compiled
def breakaway_level(friction: np.record) -> float:
    """Return the breakaway friction [V]: f_s of eq. (2.1), or the dry friction in sliding at v -> 0+."""
    if int(friction.model) == FrictionModel.STICTION:
        level: float = friction.static_level
        return level
    return sliding_terms(friction, 0.0)[0]


@compiled
def static_friction(friction: np.record, velocity: float, applied: float) -> float:
    """Return the friction [V] at a velocity [um/s]; at rest it balances ``applied`` [V] up to breakaway, eq. (2.1)."""
    if velocity == 0.0:
        held = breakaway_level(friction)
        return min(max(applied, -held), held)
    level, resistance = sliding_terms(friction, abs(velocity))
    return math.copysign(level, velocity) + resistance * velocity


@compiled
def _slide(
    friction: np.record,
    time: float,
    gain: float,
    velocity: float,
    applied: float,
    drag: float,
    direction: float,
) -> float:
    """Return the velocity after sliding for ``time`` [s] in one direction (+1 or -1), by the implicit midpoint rule."""
    mean = velocity
    # The first pass predicts the mean velocity; the second evaluates the friction at it.
    for _ in range(2):
        level, resistance = sliding_terms(friction, max(mean * direction, 0.0))
        impulse = gain * time * (applied - level * direction)
        mean = (2.0 * velocity + impulse) / (2.0 + gain * time * (resistance + drag))
    return 2.0 * mean - velocity


@compiled
def static_substep(
    friction: np.record,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with static friction by one substep.

    The body comes to rest when its velocity crosses zero within the substep or starts within the dead band. It stays at
    rest while the applied force is below the breakaway friction. The instant of the stop is interpolated.

    Parameters
    ----------
    friction
        Record with the layout :data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`.
    substep, gain
        Length D of the substep [s], and 1/m of eq. (4.1) [um/s^2/V].
    position, velocity
        Position x [um] and velocity v [um/s] at the start.
    applied
        Mean applied force over the substep, without friction [V].
    drag
        Viscous damping of the actuator (back-EMF), in addition to the friction [V s/um].

    Returns
    -------
    tuple
        Position [um] and velocity [um/s] at the end; mean friction [V].
    """
    held = breakaway_level(friction)
    end = 0.0
    remaining = substep
    new_position = position
    if abs(velocity) <= friction.dead_band_velocity:
        if abs(applied) <= held:
            new_position += 0.5 * substep * velocity
            return new_position, 0.0, applied + velocity / (gain * substep) - 0.5 * drag * velocity
        start = velocity
    else:
        direction = math.copysign(1.0, velocity)
        end = _slide(friction, substep, gain, velocity, applied, drag, direction)
        if end * direction > 0.0:
            remaining = 0.0
            new_position += 0.5 * substep * (velocity + end)
        else:
            stop = substep * velocity / (velocity - end)
            remaining = substep - stop
            new_position += 0.5 * stop * velocity
            end = 0.0
        start = 0.0
    if remaining > 0.0 and abs(applied) > held:
        end = _slide(friction, remaining, gain, start, applied, drag, math.copysign(1.0, applied))
        new_position += 0.5 * remaining * (start + end)
    mean = (new_position - position) / substep
    return new_position, end, applied - drag * mean - (end - velocity) / (gain * substep)
