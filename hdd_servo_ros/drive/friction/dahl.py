"""
The Dahl model (2.15)-(2.19) with any exponent.

(2.15) is printed as a rate in time and is the derivative with respect to position; (2.17) lacks sigma and |v|. With
y = 1 - (F/f_c) sgn v it reads dF/dx = sigma |y|^alpha sgn y. Along a displacement s >= 0 of one direction, with
l = sigma s/f_c, this is dy/dl = -y^alpha, whose solution is closed:

    alpha = 1: y = y0 e^(-l),    else y^(1-alpha) = y0^(1-alpha) + (alpha - 1) l (zero once that is negative).

The friction is thus a function of the path and not of its speed, and never leaves [-f_c, f_c].
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.lugre import decay_functions
from hdd_servo_ros.drive.friction.static import power
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp, log

PASSES = 20
"""Most passes over the mean velocity of a substep; three or four do unless the contact is stiff for the substep."""
TOLERANCE = 1.0e-9
"""Relative change of the mean velocity in the last pass; the passes converge quadratically."""


@compiled_apart
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
def dahl_force(friction: np.record, force: float, displacement: float) -> float:
    """
    Return the friction [V] after a displacement of one direction.

    Parameters
    ----------
    friction
        Record of :data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`: sigma, f_c and alpha are read.
    force
        Friction before [V], within +-f_c.
    displacement
        Signed displacement [um].
    """
    if displacement == 0.0:
        return force
    coulomb_level: float = friction.coulomb_level
    direction = math.copysign(1.0, displacement)
    y = 1.0 - force * direction / coulomb_level
    y = dahl_relaxation(y, friction.stiffness * abs(displacement) / coulomb_level, friction.dahl_exponent)
    return direction * coulomb_level * (1.0 - y)


@compiled_apart
def dahl_mean_force(friction: np.record, force: float, displacement: float, end: float) -> float:
    """
    Return the mean of the friction over a displacement of one direction [V], from its values at both ends [V].

    With the equation's dl = -y^(-alpha) dy the integral of y over the path is closed,
    (y0^(2-alpha) - y1^(2-alpha)) / (2 - alpha); where y hardly changes, the mean of the ends is used.
    """
    direction = math.copysign(1.0, displacement)
    coulomb_level: float = friction.coulomb_level
    exponent: float = friction.dahl_exponent
    length: float = friction.stiffness * abs(displacement) / coulomb_level
    start = 1.0 - force * direction / coulomb_level
    final = 1.0 - end * direction / coulomb_level
    if start - final <= 1.0e-4 * start:
        return 0.5 * (force + end)
    if exponent == 1.0:
        return direction * coulomb_level * (1.0 - start * decay_functions(length)[0])
    rest = 2.0 - exponent
    if final <= 0.0:
        area = power(start, rest) / rest if rest > 0.0 else start * length
    else:
        fall = log(start / final)
        # (y0^r - y1^r)/r = y0^r fall p1(r fall), or with y1 for r < 0, p1 being free of cancellation.
        base = start if rest >= 0.0 else final
        area = exp(rest * log(base)) * fall * decay_functions(abs(rest) * fall)[0]
    return direction * coulomb_level * (1.0 - area / length)


@compiled
def dahl_slope(friction: np.record, force: float, direction: float) -> float:
    """Return dF/dx [V/um] of (2.15) for a motion in ``direction`` (+1 or -1)."""
    stiffness: float = friction.stiffness
    y = 1.0 - force * direction / friction.coulomb_level
    if y <= 0.0:
        return 0.0
    if friction.dahl_exponent == 0.0:
        return stiffness
    return stiffness * power(y, friction.dahl_exponent)


@compiled
def dahl_substep(
    friction: np.record,
    substep: float,
    gain: float,
    velocity: float,
    deflection: float,
    previous_force: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with Dahl friction by one substep.

    The mean friction is that along the substep's own displacement, in closed form, and so its work is what the contact
    stores and loses: without input the energy does not increase. The mean velocity is found by Newton's method; the
    friction at the end follows the displacement exactly.

    Arguments as of :func:`~hdd_servo_ros.drive.friction.static.static_substep`, with the deflection F/sigma [um] at the
    start and the mean friction of the substep before [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], deflection at the end [um], mean friction [V].
    """
    stiffness = friction.stiffness
    force = stiffness * deflection
    impulse = gain * substep
    # The sum is zero at the mean velocity: sum(w) = 2 w - 2 v + k D (F(w) + drag w - u), increasing, and concave from
    # w = 0 in the direction of -sum(0).
    momentum = 2.0 * velocity + impulse * (applied - force)
    mean = velocity + 0.5 * impulse * (applied - previous_force - drag * velocity)
    end = force
    average = force
    for _ in range(PASSES):
        if mean * momentum <= 0.0:
            # The other direction: begin with the spring that the contact is at first.
            slope = dahl_slope(friction, force, math.copysign(1.0, momentum))
            mean = momentum / (2.0 + impulse * (0.5 * slope * substep + drag))
        end = dahl_force(friction, force, mean * substep)
        average = dahl_mean_force(friction, force, mean * substep, end)
        if mean == 0.0:
            break
        # d(mean force)/dw = (force at the end - mean force)/w
        gradient = 2.0 + impulse * (drag + (end - average) / mean)
        change = (2.0 * (velocity - mean) + impulse * (applied - average - drag * mean)) / gradient
        mean += change
        if abs(change) <= TOLERANCE * abs(mean):
            break
    end = dahl_force(friction, force, mean * substep)
    return mean, end / stiffness, applied - drag * mean - 2.0 * (mean - velocity) / impulse
