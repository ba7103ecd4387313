"""Least-squares fits of the friction models that are linear in their parameters (thesis chapter 2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.curves import checked_samples
from hdd_servo_ros.drive.friction.parameters import FrictionParameters

Array = npt.NDArray[np.float64]

TERMS = (
    'stiffness',
    'coulomb_level',
    'viscous_coefficient',
    'drag_coefficient',
    'square_root_coefficient',
)
"""The parameters P = [f_t, f_c, f_v, f_d, f_r] of (2.14), by their names in :class:`FrictionParameters`."""


@dataclass(frozen=True)
class LinearFit:
    """A least-squares fit: coefficients by name, and the residual."""

    coefficients: dict[str, float]
    residual_rms: float
    """Root mean square of the residual [V]."""

    def parameters(self, model: str) -> FrictionParameters:
        """
        Return the fit as parameters of ``model``.

        Raises
        ------
        ParameterError
            If a fitted coefficient is out of range, such as a negative Coulomb friction.
        """
        return replace(FrictionParameters(), model=model, **self.coefficients)  # type: ignore[arg-type]


def regressor(
    velocity: npt.ArrayLike, position: npt.ArrayLike = 0.0, dead_band_velocity: float = 0.0
) -> npt.NDArray[np.float64]:
    """
    Return the regressor S(x, v) (thesis eq. 2.14, corrected): ``[x delta(v), sgn v, v, v|v|, sqrt|v| sgn v]``.

    The thesis prints the first element without x and the root without the absolute value.

    Parameters
    ----------
    velocity
        v [um/s], one-dimensional.
    position
        x [um] relative to equilibrium; broadcast with the velocity.
    dead_band_velocity
        delta(v) is 1 where ``|v|`` is at most this [um/s].

    Returns
    -------
    ndarray
        One row per sample, one column per term of :data:`TERMS`.
    """
    v, x = np.broadcast_arrays(np.asarray(velocity, dtype=np.float64), np.asarray(position, dtype=np.float64))
    at_rest = np.abs(v) <= dead_band_velocity
    return np.stack([np.where(at_rest, x, 0.0), np.sign(v), v, v * np.abs(v), np.sqrt(np.abs(v)) * np.sign(v)], axis=-1)


def fit_linear(
    velocity: npt.ArrayLike,
    friction: npt.ArrayLike,
    terms: Sequence[str] = ('coulomb_level', 'square_root_coefficient', 'viscous_coefficient'),
    position: npt.ArrayLike = 0.0,
    dead_band_velocity: float = 0.0,
) -> LinearFit:
    """
    Fit F = S(x, v)'P (thesis eq. 2.14), or some of its terms, by least squares; default: eq. 2.11.

    Parameters
    ----------
    velocity, friction
        Measured v [um/s] and F [V], one-dimensional, of equal length.
    terms
        Terms of :data:`TERMS` to fit.
    position, dead_band_velocity
        See :func:`regressor`.

    Raises
    ------
    ValueError
        If a term is unknown, the data do not determine the terms, or are not one-dimensional, of equal length and
        finite.
    """
    for term in terms:
        if term not in TERMS:
            raise ValueError(f'unknown term {term!r}; expected {", ".join(TERMS)}')
    force = checked_samples('friction', friction)
    checked_samples('velocity', velocity, force.size)
    if np.ndim(position) != 0:
        checked_samples('position', position, force.size)
    columns = [TERMS.index(term) for term in terms]
    matrix = regressor(velocity, position, dead_band_velocity)[:, columns]
    coefficients, rms = _least_squares(matrix, force, ', '.join(terms))
    return LinearFit({term: float(value) for term, value in zip(terms, coefficients, strict=True)}, rms)


def fit_network(
    position: npt.ArrayLike, velocity: npt.ArrayLike, friction: npt.ArrayLike, parameters: FrictionParameters
) -> tuple[FrictionParameters, float]:
    """
    Fit the weights W of the network (thesis eq. 2.26) by least squares, for given centers and widths.

    Parameters
    ----------
    position, velocity, friction
        Measured x [um], v [um/s] and F [V], one-dimensional, of equal length.
    parameters
        The network's centers (``node_positions``, ``node_velocities``) and widths.

    Returns
    -------
    tuple
        The parameters with the fitted weights and the model ``rbf_network``; root mean square of the residual [V],
        epsilon (thesis eq. 2.27).

    Raises
    ------
    ValueError
        If the data do not determine the weights, or are not one-dimensional, of equal length and finite; or the centers
        are missing or differ in number.
    """
    force = checked_samples('friction', friction)
    checked_samples('velocity', velocity, force.size)
    checked_samples('position', position, force.size)
    centers = len(parameters.node_positions)
    if centers == 0 or centers != len(parameters.node_velocities):
        raise ValueError('node_positions and node_velocities need the same number of elements, at least one')
    matrix = network_basis(position, velocity, parameters)
    weights, rms = _least_squares(matrix, force, 'the weights')
    return replace(parameters, model='rbf_network', node_weights=tuple(weights.tolist())), rms


def network_basis(
    position: npt.ArrayLike, velocity: npt.ArrayLike, parameters: FrictionParameters
) -> npt.NDArray[np.float64]:
    """Return S(x, v) (thesis eq. 2.25), one row per sample and one column per node."""
    x = np.asarray(position, dtype=np.float64)[..., np.newaxis] - np.asarray(parameters.node_positions)
    v = np.asarray(velocity, dtype=np.float64)[..., np.newaxis] - np.asarray(parameters.node_velocities)
    basis: Array = np.exp(-((x / parameters.position_width) ** 2) - (v / parameters.velocity_width) ** 2)
    return basis


def lattice(positions: Sequence[float], velocities: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the centers of a regular lattice as (node_positions, node_velocities), velocity changing fastest."""
    grid = [(x, v) for x in positions for v in velocities]
    return tuple(x for x, _ in grid), tuple(v for _, v in grid)


def _least_squares(matrix: Array, target: Array, what: str) -> tuple[Array, float]:
    # Columns scale with powers of the velocity; the rank test needs normalized columns.
    scale = np.sqrt(np.mean(matrix * matrix, axis=0))
    if np.any(scale == 0.0):
        raise ValueError(f'the data do not determine {what}: a regressor is zero in all rows')
    solution, _, rank, _ = np.linalg.lstsq(matrix / scale, target, rcond=1.0e-12)
    if rank < matrix.shape[1]:
        raise ValueError(f'the data do not determine {what}: the regressors have rank {rank} of {matrix.shape[1]}')
    residual = matrix @ (solution / scale) - target
    return solution / scale, float(np.sqrt(np.mean(residual * residual)))
