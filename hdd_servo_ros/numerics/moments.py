"""Sums, extremes and changes of sampled signals, computed in one pass."""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled


@compiled
def _sums(values: NDArray[np.float64], origin: float) -> tuple[float, float, float, float]:
    """Return sum and sum of squares of the samples minus an origin, and the smallest and largest sample."""
    total, squares, lowest, highest = 0.0, 0.0, math.inf, -math.inf
    for value in values:
        moved = value - origin
        total += moved
        squares += moved * moved
        lowest = min(lowest, value)
        highest = max(highest, value)
    return total, squares, lowest, highest


@compiled
def mark_changes(rows: NDArray[np.float64], first: NDArray[np.float64], changed: NDArray[np.bool_]) -> None:
    """Set ``changed``, shape (m,), for each column of rows, shape (n, m), that differs from ``first``, shape (m,)."""
    for column in range(rows.shape[1]):
        row = 0
        while not changed[column] and row < rows.shape[0]:
            changed[column] = rows[row, column] != first[column]
            row += 1


class Moments:
    """
    Count, sums and extremes of a signal that arrives in pieces.

    Parameters
    ----------
    origin
        Value subtracted before summation; None uses the first sample, so that the mean of a constant signal is exact.
    """

    def __init__(self, origin: float | None = None) -> None:
        self.count = 0
        self.lowest, self.highest = math.inf, -math.inf
        self._origin = origin
        self._sum = self._squares = 0.0

    def add(self, values: NDArray[np.float64]) -> None:
        """Add samples, shape (n,)."""
        if not len(values):
            return
        if self._origin is None:
            self._origin = float(values[0])
        # Copying a column costs less than a second compiled function for strided arrays.
        total, squares, lowest, highest = _sums(np.ascontiguousarray(values), self._origin)
        self.count += len(values)
        self._sum += total
        self._squares += squares
        self.lowest, self.highest = min(self.lowest, lowest), max(self.highest, highest)

    @property
    def largest(self) -> float:
        """Largest magnitude; 0 without samples."""
        return max(abs(self.lowest), abs(self.highest)) if self.count else 0.0

    @property
    def span(self) -> float:
        """Largest minus smallest sample; 0 without samples."""
        return self.highest - self.lowest if self.count else 0.0

    @property
    def mean(self) -> float:
        """Mean of the samples; raises ValueError without samples."""
        if self._origin is None:
            raise ValueError('the mean needs at least one sample')
        return self._origin + self._sum / self.count

    def rms_about(self, value: float | None = None) -> float:
        """Return the rms value about ``value``, or about the mean if None; not finite if the signal is not finite."""
        if self._origin is None:
            raise ValueError('the rms value needs at least one sample')
        if value == self._origin:
            return math.sqrt(self._squares / self.count)
        mean = self._sum / self.count
        variance = self._squares / self.count - mean * mean
        # Rounding may make the variance slightly negative.
        deviation = math.sqrt(0.0 if variance < 0.0 else variance)
        return deviation if value is None else math.hypot(deviation, mean + self._origin - value)
