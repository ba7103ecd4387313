"""
Dahl friction model, thesis eqs. (2.15)-(2.19), with any exponent.

Corrected misprints of the thesis: eq. (2.15) is printed as a time derivative but is the derivative with respect to
position; eq. (2.17) lacks sigma and ``|v|``. With y = 1 - (F/f_c) sgn v, eq. (2.15) becomes
dF/dx = sigma ``|y|^alpha`` sgn y. Along a displacement s >= 0 in one direction, with l = sigma s/f_c, this is
dy/dl = -y^alpha, with the closed-form solution

    alpha = 1: y = y0 e^(-l),    else y^(1-alpha) = y0^(1-alpha) + (alpha - 1) l (zero once that is negative).

The friction therefore depends on the path but not on the speed, and stays within [-f_c, f_c].
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.lugre import decay_functions
from hdd_servo_ros.drive.friction.static import power
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp, log

PASSES = 20
"""
Maximum number of Newton iterations for the mean velocity of a substep.

Three or four suffice unless the contact is stiff compared with the substep.
"""
TOLERANCE = 1.0e-9
"""Relative change of the mean velocity that ends the iteration; the convergence is quadratic."""


@compiled_apart
def dahl_relaxation(y: float, length: float, exponent: float) -> float:
    """Return y after the normalized path ``length = sigma |dx| / f_c >= 0``, starting from 0 <= y <= 2."""
    if y <= 0.0:
        return 0.0
    if exponent == 1.0:
        return y * exp(-length)
    # y^(1-alpha) + (alpha-1) l, divided by y^(1-alpha) to avoid overflow for small y.
    argument = (exponent - 1.0) * length * exp((exponent - 1.0) * log(y))
    if argument <= -1.0:
        return 0.0
    return y * exp(-log(1.0 + argument) / (exponent - 1.0))


@compiled
def dahl_force(friction: np.record, force: float, displacement: float) -> float:
    """
    Return the friction after a displacement in one direction [V].

    Parameters
    ----------
    friction
        Record with the layout :data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`; sigma, f_c and alpha are used.
    force
        Friction before the displacement [V], within +-f_c.
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
    Return the mean friction over a displacement in one direction [V], from its values at both ends [V].

    Because dl = -y^(-alpha) dy, the integral of y over the path has the closed form
    (y0^(2-alpha) - y1^(2-alpha)) / (2 - alpha). Where y hardly changes, the mean of both ends is used.
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
        # (y0^r - y1^r)/r = y0^r fall p1(r fall), or with y1 for r < 0, because p1 is free of cancellation.
        base = start if rest >= 0.0 else final
        area = exp(rest * log(base)) * fall * decay_functions(abs(rest) * fall)[0]
    return direction * coulomb_level * (1.0 - area / length)


@compiled
def dahl_slope(friction: np.record, force: float, direction: float) -> float:
    """Return the slope dF/dx of eq. (2.15) [V/um] for a motion in ``direction`` (+1 or -1)."""
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

    The mean friction is the closed-form mean along the displacement of the substep. Its work therefore equals the
    energy that the contact stores and dissipates, and the energy does not increase without input. Newton's method
    solves for the mean velocity; the friction at the end follows from the displacement exactly.

    For the arguments see :func:`~hdd_servo_ros.drive.friction.static.static_substep`; in addition, ``deflection`` is
    F/sigma at the start [um] and ``previous_force`` is the mean friction of the previous substep [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], deflection at the end [um], mean friction [V].
    """
    stiffness = friction.stiffness
    force = stiffness * deflection
    impulse = gain * substep
    # The mean velocity w is the root of sum(w) = 2 w - 2 v + k D (F(w) + drag w - u). The sum increases with w, and is
    # concave from w = 0 in the direction of -sum(0).
    momentum = 2.0 * velocity + impulse * (applied - force)
    mean = velocity + 0.5 * impulse * (applied - previous_force - drag * velocity)
    end = force
    average = force
    for _ in range(PASSES):
        if mean * momentum <= 0.0:
            # Wrong direction: restart from the initial stiffness of the contact.
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
