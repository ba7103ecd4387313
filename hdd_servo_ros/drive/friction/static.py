"""
Static friction: functions of velocity alone, (2.1), (2.3)-(2.13), and their step with a Karnopp dead band.

Every one of them is a level times the direction of motion plus a resistance times the velocity,
F = level(|v|) sgn v + resistance(|v|) v, which is how the thesis's equations read once their misprints are corrected:
in (2.6)-(2.10) and (2.12) the falling term lacks sgn v, in (2.6) and (2.11) the velocity lacks its absolute value, and
(2.9) prints the first offset twice.
"""

import math

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.parameters import (
    COMPLETE,
    COULOMB,
    DEAD_BAND,
    DRAG,
    FIRST_OFFSET,
    INVERSE_STRIBECK,
    MODEL,
    MODELS,
    SECOND_BREAK,
    SECOND_INVERSE_STRIBECK,
    SECOND_OFFSET,
    SQUARE_ROOT,
    STATIC,
    STRIBECK_EXPONENT,
    VISCOUS,
)
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp, log

STICTION = MODELS.index('stiction')
COULOMB_ONLY = MODELS.index('coulomb')
VISCOUS_ONLY = MODELS.index('viscous')
COULOMB_VISCOUS = MODELS.index('coulomb_viscous')
DRAG_ONLY = MODELS.index('drag')
EXPONENTIAL = MODELS.index('exponential')
GAUSSIAN = MODELS.index('gaussian')
GAUSSIAN_TWO_BREAKS = MODELS.index('gaussian_two_breaks')
GAUSSIAN_OFFSETS = MODELS.index('gaussian_two_breaks_offsets')
TUSTIN = MODELS.index('tustin')
SQUARE_ROOT_LAW = MODELS.index('square_root')
LORENTZIAN = MODELS.index('lorentzian')
LORENTZIAN_TWO_BREAKS = MODELS.index('lorentzian_two_breaks')
LORENTZIAN_OFFSETS = MODELS.index('lorentzian_two_breaks_offsets')


@compiled
def power(base: float, exponent: float) -> float:
    """Return ``base`` ** ``exponent`` for base >= 0 and exponent > 0."""
    if base < 1.0e-300:
        return 0.0
    return exp(exponent * log(base))


@compiled
def gaussian(ratio: float) -> float:
    """Return exp(-ratio^2), the falling term of (2.7)-(2.9) and (2.22)."""
    return exp(-ratio * ratio)


@compiled
def lorentzian(ratio: float) -> float:
    """Return 1 / (1 + ratio^2), the falling term of (2.12)."""
    return 1.0 / (1.0 + ratio * ratio)


@compiled
def falling_level(constants: npt.NDArray[np.float64], place: int, speed: float) -> float:
    """
    Return the level of the models that fall from f_s to f_c, (2.6)-(2.10) and (2.12), at a speed |v| [um/s].

    The height of the first break is f_s1 = f_s - f_c.
    """
    model = int(constants[place + MODEL])
    coulomb: float = constants[place + COULOMB]
    first_break: float = constants[place + STATIC] - coulomb
    second_break: float = constants[place + SECOND_BREAK]
    first = speed
    second = speed
    if model in (GAUSSIAN_OFFSETS, LORENTZIAN_OFFSETS):
        first -= constants[place + FIRST_OFFSET]
        second -= constants[place + SECOND_OFFSET]
    first *= constants[place + INVERSE_STRIBECK]
    second *= constants[place + SECOND_INVERSE_STRIBECK]
    if model == GAUSSIAN:
        return coulomb + first_break * gaussian(first)
    if model in (GAUSSIAN_TWO_BREAKS, GAUSSIAN_OFFSETS):
        return coulomb + first_break * gaussian(first) + second_break * gaussian(second)
    if model == LORENTZIAN:
        return coulomb + first_break * lorentzian(first)
    if model in (LORENTZIAN_TWO_BREAKS, LORENTZIAN_OFFSETS):
        return coulomb + first_break * lorentzian(first) + second_break * lorentzian(second)
    if model == TUSTIN:
        return coulomb + first_break * exp(-first)
    return coulomb + first_break * exp(-power(first, constants[place + STRIBECK_EXPONENT]))


@compiled
def sliding_terms(constants: npt.NDArray[np.float64], place: int, speed: float) -> tuple[float, float]:
    """
    Return level [V] and resistance [V s/um] of sliding at a speed |v| [um/s]: F = level sgn v + resistance v.

    Parameters
    ----------
    constants, place
        The friction's constants begin at ``place`` of this array.
    speed
        |v| [um/s].
    """
    model = int(constants[place + MODEL])
    viscous = constants[place + VISCOUS]
    if model == STICTION:
        return 0.0, 0.0
    if model == COULOMB_ONLY:
        return constants[place + COULOMB], 0.0
    if model == VISCOUS_ONLY:
        return 0.0, viscous
    if model == COULOMB_VISCOUS:
        return constants[place + COULOMB], viscous
    if model == DRAG_ONLY:
        return 0.0, constants[place + DRAG] * speed
    if model in (SQUARE_ROOT_LAW, COMPLETE):
        level: float = constants[place + COULOMB] + constants[place + SQUARE_ROOT] * math.sqrt(speed)
        resistance: float = viscous
        if model == COMPLETE:
            resistance += constants[place + DRAG] * speed
        if level < 0.0:
            # f_r < 0: the sum is not negative, but a negative level would drive the body when its speed changes.
            return 0.0, level / speed + resistance
        return level, resistance
    return falling_level(constants, place, speed), viscous


@compiled
def breakaway_level(constants: npt.NDArray[np.float64], place: int) -> float:
    """Return the friction [V] that holds the body at rest: f_s of (2.1), or the level of sliding at v -> 0+."""
    if int(constants[place + MODEL]) == STICTION:
        level: float = constants[place + STATIC]
        return level
    return sliding_terms(constants, place, 0.0)[0]


@compiled
def static_friction(constants: npt.NDArray[np.float64], place: int, velocity: float, applied: float) -> float:
    """Return the friction [V] at a velocity [um/s]; at rest it balances ``applied`` [V] up to breakaway (2.1)."""
    if velocity == 0.0:
        held = breakaway_level(constants, place)
        return min(max(applied, -held), held)
    level, resistance = sliding_terms(constants, place, abs(velocity))
    return math.copysign(level, velocity) + resistance * velocity


@compiled
def _slide(
    constants: npt.NDArray[np.float64],
    place: int,
    time: float,
    gain: float,
    velocity: float,
    applied: float,
    drag: float,
    direction: float,
) -> float:
    """Return the velocity after sliding for ``time`` [s] in one direction (+1 or -1), by the implicit midpoint rule."""
    mean = velocity
    # The first pass predicts the mean velocity, the second takes the friction there.
    for _ in range(2):
        level, resistance = sliding_terms(constants, place, max(mean * direction, 0.0))
        impulse = gain * time * (applied - level * direction)
        mean = (2.0 * velocity + impulse) / (2.0 + gain * time * (resistance + drag))
    return 2.0 * mean - velocity


@compiled
def static_substep(
    constants: npt.NDArray[np.float64],
    place: int,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with static friction by one substep.

    The body comes to rest when its velocity passes zero inside of the substep, or begins inside of the dead band, and
    stays there while the applied force is below the breakaway level; the instant of the stop is found by interpolation.

    Parameters
    ----------
    constants, place
        The friction's constants begin at ``place`` of this array.
    substep, gain
        D [s] and 1/m of (4.1) [um/s^2/V].
    position, velocity
        x [um] and v [um/s] at the start.
    applied
        Mean of the applied force over the substep, without friction [V].
    drag
        Resistance of the actuator (back-EMF) [V s/um], beside the friction.

    Returns
    -------
    tuple
        Position [um] and velocity [um/s] at the end, mean friction [V].
    """
    held = breakaway_level(constants, place)
    end = 0.0
    remaining = substep
    new_position = position
    if abs(velocity) <= constants[place + DEAD_BAND]:
        if abs(applied) <= held:
            new_position += 0.5 * substep * velocity
            return new_position, 0.0, applied + velocity / (gain * substep) - 0.5 * drag * velocity
        start = velocity
    else:
        direction = math.copysign(1.0, velocity)
        end = _slide(constants, place, substep, gain, velocity, applied, drag, direction)
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
        end = _slide(constants, place, remaining, gain, start, applied, drag, math.copysign(1.0, applied))
        new_position += 0.5 * remaining * (start + end)
    mean = (new_position - position) / substep
    return new_position, end, applied - drag * mean - (end - velocity) / (gain * substep)
