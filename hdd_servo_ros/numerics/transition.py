"""
State transition of a linear system over a sample, bit-identical on every machine.

It uses plain arithmetic in a fixed order. The matrix exponential of a library differs in the last bits between
machines, and the runs that use it would differ too.
"""

import math
from collections.abc import Sequence

_TERMS = 18
"""Number of terms of the series; with a norm of 1/2 the first omitted term is below 1e-22."""
_LARGEST_NORM = 0.5

Matrix = list[list[float]]


def held_input_transition(
    dynamics: Sequence[Sequence[float]], inputs: Sequence[float], time_step: float
) -> tuple[Matrix, list[float]]:
    """
    Return the exact discretization of x' = A x + b u with a zero-order hold of u.

    Parameters
    ----------
    dynamics
        System matrix A, shape (n, n) [1/s].
    inputs
        Input vector b, shape (n,) [1/s].
    time_step
        T [s].

    Returns
    -------
    transition, response
        State transition matrix exp(A T), shape (n, n), and the response of the states to u = 1 at the end of the
        sample, shape (n,).

    Raises
    ------
    ValueError
        If A T is not finite.
    """
    order = len(dynamics)
    augmented = [[time_step * value for value in (*row, b)] for row, b in zip(dynamics, inputs, strict=True)]
    augmented.append([0.0] * (order + 1))
    exponential = _exponential(augmented)
    return [row[:order] for row in exponential[:order]], [row[order] for row in exponential[:order]]


def _exponential(matrix: Matrix) -> Matrix:
    """Return the exponential of a matrix, by scaling and squaring of the Taylor series."""
    halvings = 0
    norm = max(sum(abs(value) for value in row) for row in matrix)
    if not norm < math.inf:
        raise ValueError('the dynamics of the system are not finite')
    while norm > _LARGEST_NORM:
        norm *= 0.5
        halvings += 1
    scaled = [[value / 2.0**halvings for value in row] for row in matrix]
    size = range(len(matrix))
    identity = [[float(i == j) for j in size] for i in size]
    # Evaluate 1 + A/1 (1 + A/2 (1 + ...)) from the innermost bracket outward.
    result = identity
    for term in range(_TERMS, 0, -1):
        product = _product(scaled, result)
        result = [[identity[i][j] + product[i][j] / term for j in size] for i in size]
    for _ in range(halvings):
        result = _product(result, result)
    return result


def _product(left: Matrix, right: Matrix) -> Matrix:
    size = range(len(left))
    product = []
    for i in size:
        row = []
        for j in size:
            total = 0.0
            for k in size:
                total += left[i][k] * right[k][j]
            row.append(total)
        product.append(row)
    return product
