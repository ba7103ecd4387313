"""Repeatable and non-repeatable part of a signal, computed block by block."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StreamedPeriods:
    """
    Sums over the last complete periods of a signal, computed block by block.

    The sums are of differences from the first period, so that the small non-repeatable part of a nearly periodic signal
    is not lost in rounding.

    Parameters
    ----------
    samples
        Total number of samples.
    period
        Samples per period.

    Raises
    ------
    ValueError
        If the signal has fewer than two periods.
    """

    def __init__(self, samples: int, period: int) -> None:
        self.period, self.cycles = period, samples // period if period > 0 else 0
        """Samples per period, and number of complete periods."""
        if self.cycles < 2:
            raise ValueError(f'expected at least two periods of {period} samples; the signal has {samples} samples')
        self.first = samples - self.cycles * period
        """Samples before the first complete period."""
        self._count = 0
        self._origin, self._sums = np.zeros(period), np.zeros(period)
        self._lowest, self._highest = np.zeros(period), np.zeros(period)
        self._squares = 0.0

    def add(self, values: Array) -> None:
        """Add samples, shape (n,)."""
        index = self._count - self.first
        self._count += len(values)
        if index < 0:
            values, index = values[-index:], 0
        while len(values):
            phase = index % self.period
            whole = len(values) // self.period if phase == 0 and index else 0
            taken = max(whole, 1) * self.period - phase
            part = values[:taken]
            rows = slice(phase, phase + len(part) // max(whole, 1))
            if index < self.period:
                self._origin[rows] = part
            else:
                moved = part.reshape(max(whole, 1), -1) - self._origin[rows]
                self._sums[rows] += moved.sum(axis=0)
                self._squares += float(np.sum(np.square(moved)))
                np.minimum(self._lowest[rows], moved.min(axis=0), out=self._lowest[rows])
                np.maximum(self._highest[rows], moved.max(axis=0), out=self._highest[rows])
            values, index = values[taken:], index + len(part)

    @property
    def _shift(self) -> Array:
        return self._sums / self.cycles

    @property
    def mean_period(self) -> Array:
        """Mean of the periods, shape (period,), starting at the first complete period."""
        return self._origin + self._shift

    @property
    def waveform(self) -> Array:
        """The mean period in phase with the whole signal, whose first sample is that of the waveform."""
        return np.roll(self.mean_period, self.first % self.period)

    @property
    def rest_square_sum(self) -> float:
        """Sum of squares of the non-repeatable part."""
        return max(0.0, self._squares - self.cycles * float(np.sum(np.square(self._shift))))

    @property
    def rest_rms(self) -> float:
        """Root mean square of the non-repeatable part."""
        return math.sqrt(self.rest_square_sum / (self.cycles * self.period))

    @property
    def rest_peak_to_peak(self) -> float:
        """Peak-to-peak value of the non-repeatable part."""
        return float((self._highest - self._shift).max() - (self._lowest - self._shift).min())
