"""The period of a reference, from its samples alone."""

import numpy as np
from numpy.typing import ArrayLike

_TOLERANCE = 1e-6
"""By how much of its span a reference may differ from what it is taken for: stamps and messages carry float64."""


def sine_period(position: ArrayLike, acceleration: ArrayLike) -> float | None:
    """
    Return the period of a sine [s], None if the reference is none.

    Its acceleration is -omega^2 (x - c), a straight line over x, whatever its phase and offset c.

    Parameters
    ----------
    position, acceleration
        Of the reference, shape (n,), the latter per s^2.
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
    Return after how many samples a reference repeats, None if it does not twice at least, or stands still.

    Parameters
    ----------
    position
        Of the reference, shape (n,).
    """
    x = np.asarray(position, dtype=np.float64)
    span = float(x.max() - x.min())
    if span == 0.0:
        return None
    # By how much the first half differs from what comes a lag later, from sums of squares and one correlation.
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
