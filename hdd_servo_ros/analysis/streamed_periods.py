"""What repeats in a signal that comes in pieces, and what does not."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StreamedPeriods:
    """
    Sums over the periods of a signal that comes in pieces: the last whole periods count.

    Sums are those of the differences from the first period, so that the rest of a signal that repeats almost exactly is
    not lost in rounding.

    Parameters
    ----------
    samples
        How many samples will come.
    period
        Samples of a period.

    Raises
    ------
    ValueError
        If there are not two periods.
    """

    def __init__(self, samples: int, period: int) -> None:
        self.period, self.cycles = period, samples // period if period > 0 else 0
        """Samples of a period, and how many periods count."""
        if self.cycles < 2:
            raise ValueError(f'two periods of {period} samples are needed, and there are {samples} samples')
        self.first = samples - self.cycles * period
        """Samples before the first period that counts."""
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
        """Mean of the periods, shape (period,), from the first sample that counts on."""
        return self._origin + self._shift

    @property
    def waveform(self) -> Array:
        """The same in the phase of the whole signal: its first sample is the waveform's."""
        return np.roll(self.mean_period, self.first % self.period)

    @property
    def rest_square_sum(self) -> float:
        """Sum of the squares of what does not repeat."""
        return max(0.0, self._squares - self.cycles * float(np.sum(np.square(self._shift))))

    @property
    def rest_rms(self) -> float:
        """Root mean square of what does not repeat."""
        return math.sqrt(self.rest_square_sum / (self.cycles * self.period))

    @property
    def rest_peak_to_peak(self) -> float:
        """Largest less smallest value of what does not repeat."""
        return float((self._highest - self._shift).max() - (self._lowest - self._shift).min())
