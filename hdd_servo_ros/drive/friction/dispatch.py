"""
The friction models as one: the only file that knows all families.

A family has a step of its own for a rigid body (LuGre, Dahl, elastoplastic, network, static). All of them share two
numbers between steps: the deflection of the contact, and the mean friction of the last substep, which predicts the next
one and holds a static model at rest. ``friction`` is a record of
:data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`, ``nodes`` are those of the network.
"""

import math

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.dahl import dahl_force, dahl_substep
from hdd_servo_ros.drive.friction.elastoplastic import elastoplastic_friction, elastoplastic_substep, slip_terms
from hdd_servo_ros.drive.friction.lugre import lugre_bristle, lugre_friction, lugre_level, lugre_substep
from hdd_servo_ros.drive.friction.network import network_friction, network_substep
from hdd_servo_ros.drive.friction.parameters import FrictionModel
from hdd_servo_ros.drive.friction.static import sliding_terms, static_friction, static_substep
from hdd_servo_ros.numerics.compiled import compiled

Array = npt.NDArray[np.float64]

LUGRE = (FrictionModel.LUGRE, FrictionModel.LUGRE_POSITION)
ELASTOPLASTIC = (FrictionModel.TANGENTIAL_STIFFNESS, FrictionModel.COMPLETE)


@compiled
def friction_force(
    friction: np.record, nodes: Array, position: float, velocity: float, deflection: float, mean_friction: float
) -> float:
    """Return the friction [V] at a state of the rigid body and its contact."""
    model = int(friction.model)
    if model in LUGRE:
        return lugre_friction(friction, position, velocity, deflection)
    if model == FrictionModel.NONE:
        return 0.0
    if model == FrictionModel.DAHL:
        stiffness: float = friction.stiffness
        return stiffness * deflection
    if model in ELASTOPLASTIC:
        return elastoplastic_friction(friction, velocity, deflection)
    if model == FrictionModel.RBF_NETWORK:
        return network_friction(friction, nodes, position, velocity)
    return static_friction(friction, velocity, mean_friction)


@compiled
def friction_substep(
    friction: np.record,
    nodes: Array,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    deflection: float,
    mean_friction: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float, float]:
    """
    Advance a rigid body with friction by one substep, by the friction's own scheme.

    Parameters
    ----------
    friction, nodes
        The model.
    substep, gain
        D [s] and 1/m of (4.1) [um/s^2/V].
    position, velocity, deflection, mean_friction
        x [um], v [um/s] and the contact's z [um] at the start, mean friction of the substep before [V].
    applied
        Mean of the applied force over the substep, without friction [V].
    drag
        Resistance of the actuator (back-EMF) [V s/um], beside the friction.

    Returns
    -------
    tuple
        Position [um], velocity [um/s] and deflection [um] at the end, mean friction [V].
    """
    model = int(friction.model)
    if model in LUGRE:
        mean, deflection, mean_friction = lugre_substep(
            friction, substep, gain, position, velocity, deflection, mean_friction, applied, drag
        )
    elif model == FrictionModel.NONE:
        mean = (2.0 * velocity + gain * substep * applied) / (2.0 + gain * substep * drag)
    elif model == FrictionModel.DAHL:
        mean, deflection, mean_friction = dahl_substep(
            friction, substep, gain, velocity, deflection, mean_friction, applied, drag
        )
    elif model in ELASTOPLASTIC:
        mean, deflection, mean_friction = elastoplastic_substep(
            friction, substep, gain, velocity, deflection, mean_friction, applied, drag
        )
    elif model == FrictionModel.RBF_NETWORK:
        mean, mean_friction = network_substep(
            friction, nodes, substep, gain, position, velocity, mean_friction, applied, drag
        )
    else:
        position, velocity, mean_friction = static_substep(friction, substep, gain, position, velocity, applied, drag)
        return position, velocity, deflection, mean_friction
    return position + substep * mean, 2.0 * mean - velocity, deflection, mean_friction


@compiled
def deflection_limit(friction: np.record, velocity: float) -> float:
    """Return the largest deflection [um] that the contact bears at a velocity [um/s]."""
    model = int(friction.model)
    limit: float = friction.bristle_limit
    if model == FrictionModel.DAHL:
        limit = friction.coulomb_level / friction.stiffness
    elif model in ELASTOPLASTIC:
        limit = slip_terms(friction, abs(velocity))[0] / friction.stiffness
    return limit


def contact_after_change(
    friction: np.record, is_same_model: bool, velocity: float, deflection: float, mean_friction: float
) -> tuple[float, float]:
    """
    Return deflection [um] and mean friction [V] with which a contact goes on under other parameters.

    It keeps its deflection, up to what it now bears, but starts undeflected when the model was another.
    """
    if not is_same_model:
        return 0.0, 0.0
    limit = deflection_limit(friction, velocity)
    return min(max(deflection, -limit), limit), mean_friction


@compiled
def steady_friction(friction: np.record, nodes: Array, position: float, velocity: float) -> float:
    """Return the friction [V] of steady sliding; 0 at rest, the middle of the possible values."""
    model = int(friction.model)
    if model == FrictionModel.RBF_NETWORK:
        return network_friction(friction, nodes, position, velocity)
    if velocity == 0.0 or model == FrictionModel.NONE:
        return 0.0
    level: float = friction.coulomb_level
    resistance: float = 0.0
    if model in LUGRE:
        level = lugre_level(friction, position, velocity)
        resistance = friction.viscous_coefficient
    elif model in ELASTOPLASTIC:
        level, resistance = slip_terms(friction, abs(velocity))
    elif model != FrictionModel.DAHL:
        level, resistance = sliding_terms(friction, abs(velocity))
    return math.copysign(level, velocity) + resistance * velocity


@compiled
def friction_after_motion(
    friction: np.record,
    nodes: Array,
    time: float,
    start: float,
    end: float,
    velocity: float,
    deflection: float,
    force: float,
) -> tuple[float, float]:
    """
    Return deflection [um] and friction [V] of a contact after a given motion.

    Parameters
    ----------
    friction, nodes
        The model.
    time
        Duration of the motion [s], at a constant velocity.
    start, end
        x at its ends [um].
    velocity
        v at its end [um/s].
    deflection, force
        Deflection [um] and friction [V] before it.
    """
    model = int(friction.model)
    stiffness: float = friction.stiffness
    change = end - start
    if model in LUGRE:
        mean = change / time
        mean_level = lugre_level(friction, 0.5 * (end + start), mean)
        deflection, _ = lugre_bristle(time, mean, deflection, stiffness, mean_level)
        return deflection, lugre_friction(friction, end, velocity, deflection)
    if model == FrictionModel.DAHL:
        return deflection, dahl_force(friction, force, change)
    if model in ELASTOPLASTIC:
        level, resistance = slip_terms(friction, abs(velocity))
        deflection = min(max(deflection + change, -level / stiffness), level / stiffness)
        return deflection, stiffness * deflection + resistance * velocity
    return deflection, steady_friction(friction, nodes, end, velocity)
