"""
The Dahl model (2.15)-(2.19) with any exponent.

(2.15) is printed as a rate in time and is the derivative with respect to position; (2.17) lacks sigma and |v|. With
y = 1 - (F/f_c) sgn v it reads dF/dx = sigma |y|^alpha sgn y. Along a displacement s >= 0 of one direction, with
l = sigma s/f_c, this is dy/dl = -y^alpha, whose solution is closed:

    alpha = 1: y = y0 e^(-l),    else y^(1-alpha) = y0^(1-alpha) + (alpha - 1) l (zero once that is negative).

The friction is thus a function of the path and not of its speed, and never leaves [-f_c, f_c].
"""

import math

from hdd_servo_ros.drive.friction.static import power
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp, log


@compiled
def dahl_relaxation(y: float, length: float, exponent: float) -> float:
    """Return y after a path ``length`` = sigma |dx| / f_c >= 0, from 0 <= y <= 2."""
    if y <= 0.0:
        return 0.0
    if exponent == 1.0:
        return y * exp(-length)
    # y^(1-alpha) + (alpha-1) l, divided by y^(1-alpha): no overflow for small y.
    argument = (exponent - 1.0) * length * exp((exponent - 1.0) * log(y))
    if argument <= -1.0:
        return 0.0
    return y * exp(-log(1.0 + argument) / (exponent - 1.0))


@compiled
def dahl_force(force: float, displacement: float, stiffness: float, coulomb_level: float, exponent: float) -> float:
    """
    Return the friction [V] after a displacement of one direction.

    Parameters
    ----------
    force
        Friction before [V], within +-f_c.
    displacement
        Signed displacement [um].
    stiffness, coulomb_level, exponent
        sigma [V/um], f_c [V], alpha.
    """
    if displacement == 0.0:
        return force
    direction = math.copysign(1.0, displacement)
    y = 1.0 - force * direction / coulomb_level
    y = dahl_relaxation(y, stiffness * abs(displacement) / coulomb_level, exponent)
    return direction * coulomb_level * (1.0 - y)


@compiled
def dahl_slope(force: float, direction: float, stiffness: float, coulomb_level: float, exponent: float) -> float:
    """Return dF/dx [V/um] of (2.15) for a motion in ``direction`` (+1 or -1)."""
    y = 1.0 - force * direction / coulomb_level
    if y <= 0.0:
        return 0.0
    if exponent == 0.0:
        return stiffness
    return stiffness * power(y, exponent)


@compiled
def dahl_substep(
    substep: float,
    gain: float,
    velocity: float,
    force: float,
    previous_force: float,
    applied: float,
    drag: float,
    stiffness: float,
    coulomb_level: float,
    exponent: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with Dahl friction by one substep.

    The mean friction along the predicted displacement is taken from three points of the closed solution (Simpson's
    rule); its secant makes the momentum equation linear. The friction at the end follows the displacement exactly.

    Arguments as of :func:`~hdd_servo_ros.drive.friction.static.static_substep`, with the friction at the start and the
    mean friction of the substep before [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], friction at the end [V], mean friction [V].
    """
    mean = velocity + 0.5 * substep * gain * (applied - previous_force - drag * velocity)
    displacement = mean * substep
    direction = math.copysign(1.0, mean)
    secant = 0.5 * dahl_slope(force, direction, stiffness, coulomb_level, exponent) * substep
    if stiffness * abs(displacement) > 1.0e-6 * coulomb_level:
        middle = dahl_force(force, 0.5 * displacement, stiffness, coulomb_level, exponent)
        end = dahl_force(force, displacement, stiffness, coulomb_level, exponent)
        secant = (4.0 * (middle - force) + end - force) / (6.0 * mean)
    mean = (2.0 * velocity + gain * substep * (applied - force)) / (2.0 + gain * substep * (secant + drag))
    end = dahl_force(force, mean * substep, stiffness, coulomb_level, exponent)
    return mean, end, force + secant * mean
