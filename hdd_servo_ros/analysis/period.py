"""The period of a reference, estimated from its samples."""

import numpy as np
from numpy.typing import ArrayLike

_TOLERANCE = 1e-6
"""Tolerance as a fraction of the span of a reference: stamps and messages have float64 precision."""


def sine_period(position: ArrayLike, acceleration: ArrayLike) -> float | None:
    """
    Return the period of a sine [s]; None if the reference is not a sine.

    The acceleration of a sine is -omega^2 (x - c), a straight line over x for any phase and offset c.

    Parameters
    ----------
    position, acceleration
        Position and acceleration of the reference, shape (n,).
    """
    x, a = (np.asarray(values, dtype=np.float64) for values in (position, acceleration))
    x = x - 0.5 * (x.max() + x.min())
    if not np.any(x) or not np.any(a):
        return None
    slope, offset = np.polyfit(x, a, 1)
    if not slope < 0.0 or np.abs(a - offset - slope * x).max() > _TOLERANCE * np.abs(a).max():
        return None
    return float(2.0 * np.pi / np.sqrt(-slope))


def repeat(position: ArrayLike) -> int | None:
    """
    Return the period of a reference in samples; None if it has fewer than two periods, or is constant.

    Parameters
    ----------
    position
        Position of the reference, shape (n,).
    """
    x = np.asarray(position, dtype=np.float64)
    span = float(x.max() - x.min())
    if span == 0.0:
        return None
    # Difference of the first half from the same samples a lag later, from sums of squares and one correlation.
    half = len(x) // 2
    x = (x - x.min()) / span
    head = x[:half]
    length = len(x) + half
    product = np.fft.rfft(x, length) * np.conj(np.fft.rfft(head, length))
    correlation = np.fft.irfft(product, length)[: half + 1]
    squares = np.concatenate(([0.0], np.cumsum(x**2)))
    difference = squares[half : 2 * half + 1] - squares[: half + 1] + head @ head - 2.0 * correlation
    for lag in np.flatnonzero(difference[1:] < _TOLERANCE * half) + 1:
        if np.abs(x[lag:] - x[:-lag]).max() <= _TOLERANCE:
            return int(lag)
    return None
