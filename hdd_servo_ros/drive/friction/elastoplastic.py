"""
Presliding as a spring: tangential stiffness (2.2) and the complete model (2.13).

Both are printed with delta(v), which is zero whenever the body moves and so contradicts a spring of presliding. Here
the contact is a spring f_t z that carries the body until its force reaches the level of sliding, and slides on at that
level: f_s for (2.2); f_c + f_r sqrt|v|, with f_v v + f_d v|v| beside it, for (2.13), which it then is to the letter.
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.parameters import FrictionModel
from hdd_servo_ros.drive.friction.static import sliding_terms
from hdd_servo_ros.numerics.compiled import compiled


@compiled
def slip_terms(friction: np.record, speed: float) -> tuple[float, float]:
    """Return the level [V] at which the contact slips at a speed |v| [um/s], and its resistance [V s/um]."""
    if int(friction.model) == FrictionModel.TANGENTIAL_STIFFNESS:
        return friction.static_level, 0.0
    return sliding_terms(friction, speed)


@compiled
def elastoplastic_friction(friction: np.record, velocity: float, deflection: float) -> float:
    """Return the friction [V] at a velocity [um/s] and a deflection z [um] of the contact."""
    _, resistance = slip_terms(friction, abs(velocity))
    stiffness: float = friction.stiffness
    return stiffness * deflection + resistance * velocity


@compiled
def elastoplastic_substep(
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
    Advance a rigid body on an elastoplastic contact by one substep, by the implicit midpoint rule.

    Whether the contact carries or slips, the work of the mean friction is what the contact stores and what it loses,
    exactly: without input the energy does not increase, however stiff the contact is for the substep.

    Arguments as of :func:`~hdd_servo_ros.drive.friction.static.static_substep`, with the deflection z [um] at the start
    and the mean friction of the substep before [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], deflection at the end [um], mean friction [V].
    """
    stiffness = friction.stiffness
    predicted = velocity + 0.5 * substep * gain * (applied - previous_force - drag * velocity)
    level, resistance = slip_terms(friction, abs(predicted))
    total = 2.0 + gain * substep * (resistance + drag)
    mean = (2.0 * velocity + gain * substep * (applied - stiffness * deflection)) / (
        total + 0.5 * gain * substep * substep * stiffness
    )
    new_deflection = deflection + substep * mean
    if stiffness * abs(new_deflection) <= level:
        force = stiffness * (deflection + 0.5 * substep * mean)
    else:
        # The contact slips in the direction in which it was being stretched. It first takes up what is left of its
        # stretch, so that the friction's work is that of the spring and of the level over the rest of the way:
        # mean friction = level - missing/(D w), which makes the momentum equation quadratic in w.
        direction = math.copysign(1.0, new_deflection)
        left = max(level / stiffness - direction * deflection, 0.0)
        missing = 0.5 * stiffness * left * left
        momentum = direction * (2.0 * velocity + gain * substep * applied) - gain * substep * level
        if missing > 0.0:
            # Of the two forms of the positive root, the one without cancellation.
            root = math.sqrt(momentum * momentum + 4.0 * total * gain * missing)
            forward = 0.5 * (momentum + root) / total if momentum > 0.0 else 2.0 * gain * missing / (root - momentum)
            force = direction * (level - missing / (substep * forward))
        else:
            forward = momentum / total
            force = direction * level
        mean = direction * forward
        new_deflection = direction * level / stiffness
    # A level that falls with the speed takes the stretch along, down to that of v = 0 where the velocity passes zero.
    end = 2.0 * mean - velocity
    limit = slip_terms(friction, abs(end) if end * velocity > 0.0 else 0.0)[0] / stiffness
    return mean, min(max(new_deflection, -limit), limit), force + resistance * mean
