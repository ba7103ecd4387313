"""Gaussian radial basis functions on a lattice over position and velocity, (4.7)."""

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
    Write the activations exp(-(z - mu_i)^2 / eta^2) of both axes of a lattice.

    On a lattice, and with one width per axis, the Gaussian of node (i, j) is the product of one of position and one of
    velocity: 2 n exponentials give all n x n nodes.

    Parameters
    ----------
    centers
        mu_1 ... mu_n of position and of velocity, shape (2, n).
    position_inverse_square, velocity_inverse_square
        1 / eta^2 of each axis.
    x, v
        The inputs of the axes.
    activations
        Takes the result, shape (2, n).
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
    Return W'S over a lattice, S the product of the two axes' activations.

    Parameters
    ----------
    weights
        Shape (n, n), position index first.
    activations
        Those of the position and of the velocity axis, shape (2, n).
    """
    total = 0.0
    for i in range(weights.shape[0]):
        row = 0.0
        for j in range(weights.shape[1]):
            row += weights[i, j] * activations[1, j]
        total += row * activations[0, i]
    return total


def lattice(minimum: float, maximum: float, count: int) -> NDArray[np.float64]:
    """Return ``count`` evenly spaced centers from ``minimum`` to ``maximum``; the middle if there is only one."""
    if count == 1:
        return np.array([0.5 * (minimum + maximum)])
    step = (maximum - minimum) / (count - 1)
    return np.array([minimum + i * step for i in range(count)])


def largest_square_sum(centers: NDArray[np.float64], width: float) -> float:
    """Return the largest sum of squared activations of one axis over its range, on a grid of 401 points."""
    z = np.linspace(centers[0], centers[-1], 401)
    activations = np.exp(-(((z[:, None] - centers[None, :]) / width) ** 2))
    return float((activations**2).sum(axis=1).max())
