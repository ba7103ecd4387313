"""
Identification of the LuGre model from data: first the static map, then presliding.

The static map F(v) = [f_c + (f_s - f_c) exp(-(v/v_s)^2)] sgn v + sigma_2 v is linear in f_c, f_s - f_c and sigma_2
for a given v_s, so that only v_s is searched for; the three are constrained to be at least zero. With the static map
known, sigma_0 and sigma_1 are fitted to the friction during a motion that reverses, whose presliding determines them.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares, minimize_scalar, nnls

from hdd_servo_ros.drive.friction.curves import checked_samples, friction_along
from hdd_servo_ros.drive.friction.parameters import FrictionParameters

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StaticMap:
    """The fitted static map of the LuGre model."""

    coulomb_level: float
    static_level: float
    stribeck_velocity: float
    viscous_coefficient: float
    residual_rms: float
    """Root mean square of the residual [V]."""


def fit_static_map(velocity: npt.ArrayLike, friction: npt.ArrayLike) -> StaticMap:
    """
    Fit the steady sliding curve of the LuGre model.

    Parameters
    ----------
    velocity, friction
        v [um/s] and F [V] of steady sliding, one-dimensional, of equal length; v not 0, of one or both signs.

    Raises
    ------
    ValueError
        If a velocity is 0, fewer than four samples are given, or an array is not one-dimensional, of equal length and
        finite.
    """
    v = checked_samples('velocity', velocity)
    f = checked_samples('friction', friction, v.size)
    if v.size < 4 or np.any(v == 0.0):
        raise ValueError('the static map needs at least four samples of steady sliding with nonzero velocity')
    speeds = np.abs(v)

    def solve(log_stribeck: float) -> tuple[Array, float]:
        falling = np.exp(-((v / np.exp(log_stribeck)) ** 2))
        matrix = np.stack([np.sign(v), falling * np.sign(v), v / speeds.max()], axis=-1)
        solution, _ = nnls(matrix, f)
        residual = matrix @ solution - f
        return solution, float(np.mean(residual * residual))

    # The cost has local minima for v_s between samples: a coarse search first, then a bounded one.
    grid = np.linspace(np.log(speeds.min()), np.log(speeds.max()), 101)
    costs = [solve(point)[1] for point in grid]
    best = int(np.argmin(costs))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    log_stribeck = float(
        minimize_scalar(lambda point: solve(point)[1], bounds=bounds, method='bounded', options={'xatol': 1.0e-10}).x
    )
    (coulomb, drop, viscous), cost = solve(log_stribeck)
    return StaticMap(
        coulomb_level=float(coulomb),
        static_level=float(coulomb + drop),
        stribeck_velocity=float(np.exp(log_stribeck)),
        viscous_coefficient=float(viscous / speeds.max()),
        residual_rms=float(np.sqrt(cost)),
    )


def identify_lugre(
    velocity: npt.ArrayLike,
    sliding_friction: npt.ArrayLike,
    position: npt.ArrayLike,
    friction: npt.ArrayLike,
    sample_time: float,
    motion_velocity: npt.ArrayLike | None = None,
) -> tuple[FrictionParameters, float]:
    """
    Identify the six parameters of the LuGre model.

    Parameters
    ----------
    velocity, sliding_friction
        Steady sliding, see :func:`fit_static_map`.
    position, friction
        x [um] and F [V] during a motion that reverses, starting from an undeflected contact, one-dimensional, of equal
        length.
    sample_time
        Time between the samples of the motion [s].
    motion_velocity
        v [um/s] during the motion, if it was measured; otherwise it is computed from the positions.

    Returns
    -------
    tuple
        The parameters, and the root mean square of the residual during the motion [V].

    Raises
    ------
    ValueError
        For the reasons of :func:`fit_static_map` and :func:`~hdd_servo_ros.drive.friction.curves.friction_along`, or if
        the position is constant.
    ParameterError
        If the fitted static map has no Coulomb friction.

    Notes
    -----
    Source: thesis eqs. (2.20) to (2.22).

    Examples
    --------
    Recover the parameters of a LuGre contact from a sliding curve and a motion that reverses:

    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import identify_lugre
    >>> from hdd_servo_ros.drive import FrictionParameters, friction_along, friction_curve
    >>> true = FrictionParameters(coulomb_level=0.1, static_level=0.12, stiffness=0.02)
    >>> velocity = np.geomspace(1.0, 20000.0, 60)
    >>> position = 3.0 * np.sin(2.0 * np.pi * np.arange(200) / 100.0)
    >>> motion = friction_along(true, position, 1e-4)
    >>> found, residual = identify_lugre(velocity, friction_curve(true, velocity), position, motion, 1e-4)
    >>> f'{found.coulomb_level:.3f} V, {found.static_level:.3f} V, {found.stiffness:.4f} V/um'
    '0.100 V, 0.120 V, 0.0200 V/um'
    """
    static = fit_static_map(velocity, sliding_friction)
    x = checked_samples('position', position)
    f = checked_samples('friction', friction, x.size)
    # The steepest slope of friction over position is the stiffness of the bristles.
    dx = np.diff(x)
    moving = np.abs(dx) > 1.0e-3 * np.abs(dx).max(initial=0.0)
    if not np.any(moving):
        raise ValueError('the position is constant: expected a motion that reverses')
    stiffness = float(np.percentile(np.abs(np.diff(f)[moving] / dx[moving]), 90.0))
    damping = 0.1 * stiffness * sample_time
    base = FrictionParameters(
        model='lugre',
        stiffness=stiffness,
        bristle_damping=damping,
        viscous_coefficient=static.viscous_coefficient,
        coulomb_level=static.coulomb_level,
        static_level=static.static_level,
        stribeck_velocity=static.stribeck_velocity,
    )

    def at(scaled: Array) -> FrictionParameters:
        return replace(base, stiffness=stiffness * float(np.exp(scaled[0])), bristle_damping=damping * float(scaled[1]))

    result = least_squares(
        lambda scaled: friction_along(at(scaled), x, sample_time, motion_velocity)[1:] - f[1:],
        x0=np.array([0.0, 1.0]),
        bounds=([-7.0, 0.0], [7.0, np.inf]),
        x_scale=np.array([1.0, 1.0]),
        xtol=1.0e-12,
        ftol=1.0e-12,
    )
    return at(result.x), float(np.sqrt(np.mean(result.fun * result.fun)))
