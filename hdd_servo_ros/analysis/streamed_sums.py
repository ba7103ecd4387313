"""Sums over consecutive samples of a signal, computed block by block."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StreamedVariation:
    """Total variation: sum of the magnitudes of all changes per sample."""

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
    """Area of a closed curve, computed block by block; see :func:`~.metrics.loop_area`."""

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
        """Return the mean area per cycle."""
        if self._first is None:
            return 0.0
        # The last point connects to the first.
        (x, f), (first_x, first_f) = self._last, self._first
        return (self._sum + 0.5 * (first_f + f) * (first_x - x)) / cycles


class StreamedOffTrack:
    """Number of samples beyond a limit, in total and consecutively; see :func:`~.off_track.off_track`."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.count = self.longest = 0
        self._running = 0

    def add(self, error: Array) -> None:
        """Add samples, shape (n,)."""
        if not len(error):
            return
        # nan exceeds any limit.
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
