"""
Dispatch to the friction models; the only module that depends on all model families.

Each family (LuGre, Dahl, elastoplastic, network, static) has its own integration step for a rigid body. All families
keep the same two states between steps: the deflection of the contact, and the mean friction of the last substep. The
latter predicts the next mean friction and holds a static model at rest. ``friction`` is a record with the layout
:data:`~hdd_servo_ros.drive.friction.parameters.FRICTION`; ``nodes`` are the nodes of the network.
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
    """Return the friction for a state of the rigid body and its contact [V]."""
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
    Advance a rigid body with friction by one substep, with the scheme of the friction family.

    Parameters
    ----------
    friction, nodes
        Friction constants and network nodes.
    substep, gain
        Length D of the substep [s], and 1/m of eq. (4.1) [um/s^2/V].
    position, velocity, deflection, mean_friction
        Position x [um], velocity v [um/s] and contact deflection z [um] at the start; mean friction of the previous
        substep [V].
    applied
        Mean applied force over the substep, without friction [V].
    drag
        Viscous damping of the actuator (back-EMF), in addition to the friction [V s/um].

    Returns
    -------
    tuple
        Position [um], velocity [um/s] and deflection [um] at the end; mean friction [V].
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
    """Return the largest deflection of the contact at a velocity [um/s], in um."""
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
    Return deflection [um] and mean friction [V] of a contact after a parameter change.

    The contact keeps its deflection, limited to the largest that the new parameters allow. It restarts undeflected when
    the friction model changes.
    """
    if not is_same_model:
        return 0.0, 0.0
    limit = deflection_limit(friction, velocity)
    return min(max(deflection, -limit), limit), mean_friction


@compiled
def steady_friction(friction: np.record, nodes: Array, position: float, velocity: float) -> float:
    """Return the friction in steady sliding [V]; at rest 0, the middle of the possible values."""
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
        Friction constants and network nodes.
    time
        Duration of the motion at constant velocity [s].
    start, end
        Position x at the start and at the end [um].
    velocity
        Velocity v at the end [um/s].
    deflection, force
        Deflection [um] and friction [V] before the motion.
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
