"""
Neural network friction model, thesis eqs. (2.25)-(2.27): Gaussian radial basis functions of position and velocity.

Position and velocity have different units, so each axis has its own width; eq. (2.25) is the case of equal widths.
"""

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp


@compiled
def network_friction(friction: np.record, nodes: npt.NDArray[np.float64], position: float, velocity: float) -> float:
    """Return the network output W'S(x, v) of eq. (2.26) [V] at a position [um] and a velocity [um/s]."""
    force = 0.0
    for i in range(len(nodes)):
        x = (position - nodes[i, 0]) * friction.inverse_position_width
        v = (velocity - nodes[i, 1]) * friction.inverse_velocity_width
        force += nodes[i, 2] * exp(-(x * x + v * v))
    return force


@compiled
def network_substep(
    friction: np.record,
    nodes: npt.NDArray[np.float64],
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    previous_force: float,
    applied: float,
    drag: float,
) -> tuple[float, float]:
    """
    Advance a rigid body with network friction by one substep, using the midpoint rule with a predicted midpoint.

    For the arguments see :func:`~hdd_servo_ros.drive.friction.static.static_substep`; in addition, ``nodes`` is the
    array from :func:`~hdd_servo_ros.drive.friction.parameters.friction_nodes` and ``previous_force`` is the mean
    friction of the previous substep [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], mean friction [V].
    """
    predicted = velocity + 0.5 * substep * gain * (applied - previous_force - drag * velocity)
    force = network_friction(friction, nodes, position + 0.25 * substep * (velocity + predicted), predicted)
    mean = (2.0 * velocity + gain * substep * (applied - force)) / (2.0 + gain * substep * drag)
    return mean, force
