"""
The neural friction model (2.25)-(2.27): Gaussian radial basis functions of position and velocity.

Position and velocity have different units, so each axis has its own width here; (2.25) with one width is the case of
equal numbers.
"""

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.parameters import (
    INVERSE_POSITION_WIDTH,
    INVERSE_VELOCITY_WIDTH,
    NODE_CONSTANTS,
    NODES,
)
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp


@compiled
def network_friction(constants: npt.NDArray[np.float64], place: int, position: float, velocity: float) -> float:
    """Return W'S(x, v) [V] of (2.26) at a position [um] and a velocity [um/s]."""
    force = 0.0
    node = place + NODE_CONSTANTS
    for _ in range(int(constants[place + NODES])):
        x = (position - constants[node]) * constants[place + INVERSE_POSITION_WIDTH]
        v = (velocity - constants[node + 1]) * constants[place + INVERSE_VELOCITY_WIDTH]
        force += constants[node + 2] * exp(-(x * x + v * v))
        node += 3
    return force


@compiled
def network_substep(
    constants: npt.NDArray[np.float64],
    place: int,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    previous_force: float,
    applied: float,
    drag: float,
) -> tuple[float, float]:
    """
    Advance a rigid body with network friction by one substep, by the midpoint rule with a predicted midpoint.

    Arguments as of :func:`~hdd_servo_ros.drive.friction.static.static_substep`, with the mean friction of the substep
    before [V].

    Returns
    -------
    tuple
        Mean velocity [um/s], mean friction [V].
    """
    predicted = velocity + 0.5 * substep * gain * (applied - previous_force - drag * velocity)
    force = network_friction(constants, place, position + 0.25 * substep * (velocity + predicted), predicted)
    mean = (2.0 * velocity + gain * substep * (applied - force)) / (2.0 + gain * substep * drag)
    return mean, force
