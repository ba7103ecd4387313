"""Gaussian radial basis functions on a lattice over position and velocity, thesis eq. (4.7)."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp


@compiled
def activate(
    centers: NDArray[np.float64],
    position_inverse_square: float,
    velocity_inverse_square: float,
    x: float,
    v: float,
    activations: NDArray[np.float64],
) -> None:
    """
    Compute the activations exp(-(z - mu_i)^2 / eta^2) of both axes of a lattice.

    On a lattice with one width per axis, the Gaussian of node (i, j) is the product of one of position and one of
    velocity, so that 2 n exponentials give all n x n nodes.

    Parameters
    ----------
    centers
        Centers mu_1 ... mu_n of position and of velocity, shape (2, n).
    position_inverse_square, velocity_inverse_square
        1 / eta^2 of each axis.
    x, v
        Inputs of the axes.
    activations
        Output array, shape (2, n).
    """
    for i in range(centers.shape[1]):
        distance = x - centers[0, i]
        activations[0, i] = exp(-(distance * distance * position_inverse_square))
    for j in range(centers.shape[1]):
        distance = v - centers[1, j]
        activations[1, j] = exp(-(distance * distance * velocity_inverse_square))


@compiled
def lattice_sum(weights: NDArray[np.float64], activations: NDArray[np.float64]) -> float:
    """
    Return W'S over a lattice, where S is the product of the activations of both axes.

    Parameters
    ----------
    weights
        Shape (n, n), position index first.
    activations
        Activations of the position and of the velocity axis, shape (2, n).
    """
    total = 0.0
    for i in range(weights.shape[0]):
        row = 0.0
        for j in range(weights.shape[1]):
            row += weights[i, j] * activations[1, j]
        total += row * activations[0, i]
    return total


def lattice(minimum: float, maximum: float, count: int) -> NDArray[np.float64]:
    """Return ``count`` evenly spaced centers from ``minimum`` to ``maximum``; the midpoint for a single one."""
    if count == 1:
        return np.array([0.5 * (minimum + maximum)])
    step = (maximum - minimum) / (count - 1)
    return np.array([minimum + i * step for i in range(count)])


def largest_square_sum(centers: NDArray[np.float64], width: float) -> float:
    """Return the largest sum of squared activations of one axis over its range, on a grid of 401 points."""
    z = np.linspace(centers[0], centers[-1], 401)
    activations = np.exp(-(((z[:, None] - centers[None, :]) / width) ** 2))
    return float((activations**2).sum(axis=1).max())
