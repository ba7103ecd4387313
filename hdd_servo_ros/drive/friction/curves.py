"""Friction of any model as arrays: in steady sliding and along a given motion."""

import math

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.dispatch import friction_after_motion, steady_friction
from hdd_servo_ros.drive.friction.parameters import FRICTION, FrictionParameters, friction_constants, friction_nodes
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import record

Array = npt.NDArray[np.float64]


def friction_curve(
    parameters: FrictionParameters, velocity: npt.ArrayLike, position: npt.ArrayLike = 0.0
) -> npt.NDArray[np.float64]:
    """
    Return the steady-state friction in sliding.

    A dynamic model gives its steady state: g(v) sgn v + sigma_2 v for the LuGre model, f_c sgn v for the Dahl model,
    the breakaway force for a tangential stiffness. At rest the result is 0, the middle of the possible values.

    Parameters
    ----------
    parameters
        Parameters of the friction model.
    velocity
        Velocity v [um/s], an array of any shape.
    position
        Position x [um], for the models that depend on it; broadcast against the velocity.

    Returns
    -------
    ndarray
        Friction [V], with the broadcast shape.

    Notes
    -----
    Source: thesis eqs. (2.1) to (2.27).

    Examples
    --------
    >>> from hdd_servo_ros.drive import FrictionParameters, friction_curve
    >>> friction_curve(FrictionParameters(), [-1000.0, 0.0, 1000.0, 10000.0]).round(4).tolist()
    [-0.1346, 0.0, 0.1346, 0.176]
    """
    velocities, positions = np.broadcast_arrays(
        np.asarray(velocity, dtype=np.float64), np.asarray(position, dtype=np.float64)
    )
    result = np.zeros(velocities.shape)
    constants, nodes = friction_constants(parameters), friction_nodes(parameters)
    _fill_curve(constants, nodes, np.ravel(positions), np.ravel(velocities), result.reshape(-1))
    return result


def friction_along(
    parameters: FrictionParameters,
    position: npt.ArrayLike,
    sample_time: float,
    velocity: npt.ArrayLike | None = None,
) -> npt.NDArray[np.float64]:
    """
    Return the friction along a given motion, starting from an undeflected contact at the first sample.

    Between two samples the solution is exact for constant velocity (Dahl, LuGre, elastoplastic). The friction at a
    sample uses the velocity at that sample: the given velocity, or the mean of the velocities in the two adjacent
    intervals (extrapolated at the last sample). The result is therefore of second order in the sample time.

    Parameters
    ----------
    parameters
        Parameters of the friction model.
    position
        Position x at equidistant times [um]; one-dimensional, at least one sample.
    sample_time
        Time between the samples [s].
    velocity
        Measured velocity v at the samples [um/s], optional; same length as ``position``.

    Returns
    -------
    ndarray
        Friction at each sample [V]; 0 at the first sample.

    Raises
    ------
    ValueError
        If the sample time is not positive and finite, or the arrays are not one-dimensional and finite with equal
        lengths.

    Notes
    -----
    Source: thesis eqs. (2.2), (2.13), (2.15), (2.20) to (2.24).

    Examples
    --------
    Presliding: the friction follows the position like a spring, with hysteresis on the return path.

    >>> import numpy as np
    >>> from hdd_servo_ros.drive import FrictionParameters, friction_along
    >>> position = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    >>> friction_along(FrictionParameters(), position, sample_time=1e-3).round(5).tolist()
    [0.0, 0.01377, 0.01999, 0.00449, -0.00645]
    """
    positions = checked_samples('position', position)
    if not 0.0 < sample_time < math.inf:
        raise ValueError(f'invalid sample_time: {sample_time!r}; expected a finite number above 0 [s]')
    if velocity is None:
        velocities = _centered_velocity(positions, sample_time)
    else:
        velocities = checked_samples('velocity', velocity, positions.size)
    result = np.zeros(positions.size)
    constants, nodes = friction_constants(parameters), friction_nodes(parameters)
    _fill_along(constants, nodes, positions, velocities, sample_time, result)
    return result


def checked_samples(name: str, values: npt.ArrayLike, size: int | None = None) -> Array:
    """
    Return measured samples as an array.

    Raises
    ------
    ValueError
        If the array is empty or not one-dimensional, has non-finite samples, or does not have ``size`` samples.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if np.ndim(values) != 1 or array.size == 0:
        raise ValueError(f'{name} has the shape {np.shape(values)}; expected a non-empty one-dimensional array')
    if size is not None and array.size != size:
        raise ValueError(f'{name} has {array.size} samples; expected {size}, as many as the other arrays')
    if not np.isfinite(array).all():
        raise ValueError(f'{name} has samples that are not finite, the first at index {np.argmin(np.isfinite(array))}')
    return array


def _centered_velocity(positions: Array, sample_time: float) -> Array:
    intervals = np.diff(positions) / sample_time
    if intervals.size < 2:
        return np.full(positions.size, intervals[0] if intervals.size else 0.0)
    middle = 0.5 * (intervals[1:] + intervals[:-1])
    first = 1.5 * intervals[0] - 0.5 * intervals[1]
    last = 1.5 * intervals[-1] - 0.5 * intervals[-2]
    return np.concatenate(([first], middle, [last]))


@compiled
def _fill_curve(constants: Array, nodes: Array, positions: Array, velocities: Array, result: Array) -> None:
    friction = record(constants, FRICTION)
    for i in range(result.size):
        result[i] = steady_friction(friction, nodes, positions[i], velocities[i])


@compiled
def _fill_along(
    constants: Array, nodes: Array, positions: Array, velocities: Array, sample_time: float, result: Array
) -> None:
    friction = record(constants, FRICTION)
    deflection = 0.0
    force = 0.0
    for i in range(1, result.size):
        deflection, force = friction_after_motion(
            friction, nodes, sample_time, positions[i - 1], positions[i], velocities[i], deflection, force
        )
        result[i] = force
