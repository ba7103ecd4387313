"""Sums over a signal that comes in pieces, where a sample counts together with the one before."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StreamedVariation:
    """Sum of the magnitudes of all changes from sample to sample."""

    def __init__(self) -> None:
        self.total = 0.0
        self._last: float | None = None

    def add(self, values: Array) -> None:
        """Add samples, shape (n,)."""
        if len(values):
            before = values[0] if self._last is None else self._last
            self.total += float(np.abs(np.diff(values, prepend=before)).sum())
            self._last = float(values[-1])


class StreamedLoopArea:
    """The area that a closed curve encloses, whose points come in pieces; see :func:`~.metrics.loop_area`."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._first: tuple[float, float] | None = None
        self._last = (0.0, 0.0)

    def add(self, displacement: Array, force: Array) -> None:
        """Add points, each of shape (n,)."""
        if not len(displacement):
            return
        if self._first is None:
            self._first = self._last = float(displacement[0]), float(force[0])
        x, f = (np.append(last, values) for last, values in zip(self._last, (displacement, force), strict=True))
        self._sum += float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x)))
        self._last = float(x[-1]), float(f[-1])

    def area(self, cycles: int) -> float:
        """Return the area of a cycle, the mean of all."""
        if self._first is None:
            return 0.0
        # The last point joins the first.
        (x, f), (first_x, first_f) = self._last, self._first
        return (self._sum + 0.5 * (first_f + f) * (first_x - x)) / cycles


class StreamedOffTrack:
    """How many samples are beyond a limit, and how many at most in a row; see :func:`~.off_track.off_track`."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.count = self.longest = 0
        self._running = 0

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        if not len(error):
            return
        # What is not a number is beyond any limit.
        inside = np.flatnonzero(np.abs(error) <= self.limit)
        self.count += len(error) - len(inside)
        if not len(inside):
            self._running += len(error)
            self.longest = max(self.longest, self._running)
            return
        between = int(np.diff(inside).max(initial=1)) - 1
        self.longest = max(self.longest, self._running + int(inside[0]), between)
        self._running = len(error) - 1 - int(inside[-1])
        self.longest = max(self.longest, self._running)
