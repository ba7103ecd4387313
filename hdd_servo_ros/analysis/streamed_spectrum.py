"""Spectra computed block by block, with the same segments and mean as for the whole signal."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SEGMENTS_AT_ONCE = 8


class StreamedSpectrum:
    """
    Welch's method, block by block.

    Parameters
    ----------
    samples
        Total number of samples.
    segment
        Largest number of samples per segment; segments overlap by half.
    power
        Returns frequencies [Hz] and the mean power of segments, from samples and segment length.
    """

    def __init__(self, samples: int, segment: int, power: Callable[[Array, int], tuple[Array, Array]]) -> None:
        self._segment = min(segment, samples)
        self._step = self._segment - self._segment // 2
        self._power = power
        self._waiting: list[Array] = []
        self._held = self._segments = 0
        self._frequencies = self._sum = np.empty(0)

    def add(self, values: Array) -> None:
        """Add samples, shape (n,)."""
        self._waiting.append(np.array(values, dtype=np.float64))
        self._held += len(values)
        if self._held >= self._segment + (_SEGMENTS_AT_ONCE - 1) * self._step:
            self._take()

    def _take(self) -> None:
        """Process the complete segments."""
        values = np.concatenate(self._waiting)
        count = (len(values) - self._segment) // self._step + 1
        if count > 0:
            self._frequencies, power = self._power(values[: self._segment + (count - 1) * self._step], self._segment)
            self._sum = count * power + (self._sum if self._segments else 0.0)
            self._segments += count
            values = values[count * self._step :]
        self._waiting, self._held = [values], len(values)

    def result(self) -> tuple[Array, Array]:
        """Return frequencies [Hz] and the mean power of all segments."""
        if self._waiting:
            self._take()
        return self._frequencies, self._sum / max(self._segments, 1)


class StreamedDensity:
    """
    The TMR from the periodogram of a whole signal (thesis eq. 1.1), by Parseval's theorem.

    The trapezoidal integral of the density is the variance minus half of the power of the last line.

    Parameters
    ----------
    samples
        Total number of samples, at least 2.
    """

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._count = 0
        self._last_line = self._constant = 0j

    def add(self, values: Array) -> None:
        """Add samples, shape (n,)."""
        index = np.arange(self._count, self._count + len(values))
        # For an odd number of samples the last line is half a line below the Nyquist frequency.
        turn = 1.0 if self._samples % 2 == 0 else np.exp(1j * np.pi * index / self._samples)
        wave = np.where(index % 2, -1.0, 1.0) * turn
        self._last_line += complex(np.sum(values * wave))
        self._constant += complex(np.sum(wave))
        self._count += len(values)

    def misregistration(self, mean: float, variance: float) -> float:
        """Return 3 times the root of the integral, for a signal with this mean and variance."""
        line = abs(self._last_line - mean * self._constant) / self._samples
        lines = 1.0 if self._samples % 2 == 0 else 2.0
        return 3.0 * math.sqrt(max(0.0, variance - 0.5 * lines * line**2))
