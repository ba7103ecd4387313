"""
Elastoplastic friction: tangential stiffness, thesis eq. (2.2), and the complete model, eq. (2.13).

The thesis prints both with delta(v), which is zero whenever the body moves and so contradicts a presliding spring. Here
the contact is a spring f_t z that carries the body until its force reaches the sliding friction, and then slips at that
force. The sliding friction is f_s for eq. (2.2). For eq. (2.13) it is f_c + f_r ``sqrt|v|``, in addition to
f_v v + f_d v ``|v|``; in sliding the model then equals eq. (2.13) exactly.
"""

import math

import numpy as np

from hdd_servo_ros.drive.friction.parameters import FrictionModel
from hdd_servo_ros.drive.friction.static import sliding_terms
from hdd_servo_ros.numerics.compiled import compiled


@compiled
def slip_terms(friction: np.record, speed: float) -> tuple[float, float]:
    """Return the slip force of the contact [V] and its viscous damping [V s/um] at a speed ``|v|`` [um/s]."""
    if int(friction.model) == FrictionModel.TANGENTIAL_STIFFNESS:
        return friction.static_level, 0.0
    return sliding_terms(friction, speed)


@compiled
def elastoplastic_friction(friction: np.record, velocity: float, deflection: float) -> float:
    """Return the friction at a velocity [um/s] and a contact deflection z [um], in V."""
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

    In sticking and in slip, the work of the mean friction equals exactly the energy that the contact stores and
    dissipates. Without input the energy does not increase, however stiff the contact is compared with the substep.

    For the arguments see :func:`~hdd_servo_ros.drive.friction.static.static_substep`; in addition, ``deflection`` is z
    at the start [um] and ``previous_force`` is the mean friction of the previous substep [V].

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
        # The contact slips in the direction of its stretch. It first stretches up to the slip limit, so the work of the
        # friction is that of the spring, plus that of the slip force over the rest of the displacement:
        # mean friction = level - deficit/(D w). The momentum equation is therefore quadratic in w.
        direction = math.copysign(1.0, new_deflection)
        remaining = max(level / stiffness - direction * deflection, 0.0)
        deficit = 0.5 * stiffness * remaining * remaining
        momentum = direction * (2.0 * velocity + gain * substep * applied) - gain * substep * level
        if deficit > 0.0:
            # Use the form of the positive root that has no cancellation.
            root = math.sqrt(momentum * momentum + 4.0 * total * gain * deficit)
            forward = 0.5 * (momentum + root) / total if momentum > 0.0 else 2.0 * gain * deficit / (root - momentum)
            force = direction * (level - deficit / (substep * forward))
        else:
            forward = momentum / total
            force = direction * level
        mean = direction * forward
        new_deflection = direction * level / stiffness
    # A slip force that decreases with speed limits the stretch too; where the velocity changes sign, use that of v = 0.
    end = 2.0 * mean - velocity
    limit = slip_terms(friction, abs(end) if end * velocity > 0.0 else 0.0)[0] / stiffness
    return mean, min(max(new_deflection, -limit), limit), force + resistance * mean
