"""Sums, extremes and changes of samples, in one pass."""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled


@compiled
def _sums(values: NDArray[np.float64], origin: float) -> tuple[float, float, float, float]:
    """Return sum and sum of squares of samples less an origin, and the smallest and largest sample."""
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
    """Set ``changed`` for every column of rows, shape (n, m), that is not ``first`` throughout; both of shape (m,)."""
    for column in range(rows.shape[1]):
        row = 0
        while not changed[column] and row < rows.shape[0]:
            changed[column] = rows[row, column] != first[column]
            row += 1


class Moments:
    """
    Count, sums and extremes of a signal that comes in pieces.

    Parameters
    ----------
    origin
        What is subtracted before summing up; None for the first sample, so that the mean of a signal that stands still
        is exact.
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
        # A copy of a column costs less than a second compiled function for it.
        total, squares, lowest, highest = _sums(np.ascontiguousarray(values), self._origin)
        self.count += len(values)
        self._sum += total
        self._squares += squares
        self.lowest, self.highest = min(self.lowest, lowest), max(self.highest, highest)

    @property
    def largest(self) -> float:
        """Largest magnitude; 0 if there is no sample."""
        return max(abs(self.lowest), abs(self.highest)) if self.count else 0.0

    @property
    def span(self) -> float:
        """Largest less smallest sample; 0 if there is none."""
        return self.highest - self.lowest if self.count else 0.0

    @property
    def mean(self) -> float:
        """Mean; raises ValueError if there is no sample."""
        if self._origin is None:
            raise ValueError('no sample, no mean')
        return self._origin + self._sum / self.count

    def rms_about(self, value: float | None = None) -> float:
        """Return the root mean square about a value, about the mean if None; it is not finite if the signal is not."""
        if self._origin is None:
            raise ValueError('no sample, no root mean square')
        if value == self._origin:
            return math.sqrt(self._squares / self.count)
        mean = self._sum / self.count
        variance = self._squares / self.count - mean * mean
        # Rounding may leave a little less than nothing.
        deviation = math.sqrt(0.0 if variance < 0.0 else variance)
        return deviation if value is None else math.hypot(deviation, mean + self._origin - value)
