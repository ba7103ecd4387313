"""Friction of every model over arrays: in steady sliding, and along a given motion."""

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
    Return the friction of steady sliding.

    A dynamic model gives what it settles to: the LuGre model g(v) sgn v + sigma_2 v, Dahl's f_c sgn v, a tangential
    stiffness its breakaway level. At rest the result is 0, the middle of the possible values.

    Parameters
    ----------
    parameters
        The model.
    velocity
        v [um/s], of any shape.
    position
        x [um], for the models that depend on it; broadcast against the velocity.

    Returns
    -------
    ndarray
        Friction [V], of the broadcast shape.

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
    Return the friction along a given motion, from an undeflected contact at its first sample.

    Between two samples the contact follows the motion at constant velocity, exactly (Dahl, LuGre, elastoplastic). The
    friction at a sample is that of its own velocity: the one given, or the mean of the velocities of the intervals on
    both sides (extrapolated at the last sample), so that the whole is of second order in the sample time.

    Parameters
    ----------
    parameters
        The model.
    position
        x at equidistant times [um], one-dimensional, at least one sample.
    sample_time
        Time between the samples [s].
    velocity
        v at the samples [um/s], if it was measured too; of the positions' length.

    Returns
    -------
    ndarray
        Friction [V] at each sample; 0 at the first.

    Raises
    ------
    ValueError
        If the sample time is not positive and finite, or an array is not one-dimensional, of equal length and finite.

    Notes
    -----
    Source: thesis eqs. (2.2), (2.13), (2.15), (2.20) to (2.24).

    Examples
    --------
    Presliding: the friction follows the position like a spring, and lags behind it on the way back.

    >>> import numpy as np
    >>> from hdd_servo_ros.drive import FrictionParameters, friction_along
    >>> position = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    >>> friction_along(FrictionParameters(), position, sample_time=1e-3).round(5).tolist()
    [0.0, 0.01377, 0.01999, 0.00449, -0.00645]
    """
    positions = checked_samples('position', position)
    if not 0.0 < sample_time < math.inf:
        raise ValueError(f'sample_time: {sample_time!r}; expected above 0 and finite [s]')
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
        If they are not a one-dimensional array of finite numbers, of ``size`` if that is given, or there are none.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if np.ndim(values) != 1 or array.size == 0:
        raise ValueError(f'{name} has the shape {np.shape(values)}: a one-dimensional array of samples is needed')
    if size is not None and array.size != size:
        raise ValueError(f'{name} has {array.size} samples: {size} are needed, as many as of the others')
    if not np.isfinite(array).all():
        raise ValueError(f'{name} has samples that are not finite, the first at {np.argmin(np.isfinite(array))}')
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
