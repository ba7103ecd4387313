"""Gaussian radial basis functions on a lattice over position and velocity, (4.7)."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp


@compiled
def fill_axis(
    centres: NDArray[np.float64],
    at: int,
    count: int,
    inverse_square: float,
    z: float,
    out: NDArray[np.float64],
    to: int,
) -> None:
    """
    Write exp(-(z - mu_i)^2 / eta^2) of one axis for ``count`` centres.

    On a lattice, and with one width an axis, the Gaussian of node (i, j) is the product of one of position and one of
    velocity: 2 n exponentials give all n x n nodes.

    Parameters
    ----------
    centres, at
        Array that holds mu_1 ... mu_count from index ``at`` on.
    count
        Number of centres.
    inverse_square
        1 / eta^2.
    z
        The input of this axis.
    out, to
        Array that takes the result from index ``to`` on.
    """
    for i in range(count):
        distance = z - centres[at + i]
        out[to + i] = exp(-(distance * distance * inverse_square))


@compiled
def lattice_sum(values: NDArray[np.float64], weights: int, activations: int, count: int) -> float:
    """
    Return W'S over a lattice, S the product of the two axes' activations.

    Parameters
    ----------
    values
        Array that holds everything.
    weights
        Index from which the count x count weights stand, position index first.
    activations
        Index from which the activations of the position axis stand, those of the velocity axis behind them.
    count
        Nodes an axis.
    """
    total = 0.0
    for i in range(count):
        row = 0.0
        for j in range(count):
            row += values[weights + i * count + j] * values[activations + count + j]
        total += row * values[activations + i]
    return total


def lattice(minimum: float, maximum: float, count: int) -> NDArray[np.float64]:
    """Return ``count`` evenly spaced centres from ``minimum`` to ``maximum``; the middle if there is only one."""
    if count == 1:
        return np.array([0.5 * (minimum + maximum)])
    step = (maximum - minimum) / (count - 1)
    return np.array([minimum + i * step for i in range(count)])


def largest_square_sum(centres: NDArray[np.float64], width: float) -> float:
    """Return the largest sum of squared activations of one axis over its range, on a grid of 401 points."""
    z = np.linspace(centres[0], centres[-1], 401)
    activations = np.exp(-(((z[:, None] - centres[None, :]) / width) ** 2))
    return float((activations**2).sum(axis=1).max())
