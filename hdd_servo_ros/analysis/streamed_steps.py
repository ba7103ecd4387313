"""Edges of a reference and step responses, computed block by block."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import StepResponse, counted_edges

Array = NDArray[np.float64]


class StreamedEdges:
    """
    Edges of a reference, computed block by block as long as it may be stepwise.

    Parameters
    ----------
    samples
        Total number of samples.
    """

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._count = 0
        self._last = 0.0
        self._rows: list[NDArray[np.int64]] = []
        self._heights: list[Array] = []
        self._jumps = 0
        self._last_jump = -2
        self.is_stepwise = True
        """Whether the reference is constant except for a few steps; see :func:`~.metrics.is_stepwise`."""

    def add(self, reference: Array) -> None:
        """Add samples of x_d, shape (n,)."""
        if not self.is_stepwise or not len(reference):
            return
        changes = np.diff(reference, prepend=self._last if self._count else reference[0])
        rows = np.flatnonzero(changes)
        self._heights.append(changes[rows])
        rows += self._count
        self._rows.append(rows)
        self._jumps += len(rows)
        apart = np.diff(rows, prepend=self._last_jump)
        self.is_stepwise = self._jumps <= self._samples / 10 and not (len(apart) and int(apart.min()) <= 1)
        if not self.is_stepwise:
            self._rows, self._heights = [], []
        elif len(rows):
            self._last_jump = int(rows[-1])
        self._count += len(reference)
        self._last = float(reference[-1])

    @property
    def rows(self) -> NDArray[np.int64]:
        """The first row with each new reference, shape (m,)."""
        return np.concatenate([np.empty(0, dtype=np.int64), *self._rows])

    @property
    def heights(self) -> Array:
        """New minus previous reference, shape (m,)."""
        return np.concatenate([np.empty(0), *self._heights])


class StreamedSteps:
    """
    Responses to known edges, computed block by block; see :func:`~.metrics.step_response`.

    Parameters
    ----------
    edges
        Edges of the whole reference.
    samples
        Total number of samples.
    first_offset
        x_d - x at the first sample.
    band, steady_part
        See :func:`~.metrics.step_response`.

    Raises
    ------
    ValueError
        If the reference has no edge.
    """

    def __init__(
        self,
        edges: StreamedEdges,
        samples: int,
        first_offset: float,
        band: float = 0.02,
        steady_part: float = 0.5,
    ) -> None:
        rows, heights, ends = counted_edges(edges.rows, edges.heights, samples, first_offset)
        self._rows, self._heights, self._ends = rows, heights, ends
        lengths = ends - rows
        self._steady_rows = rows + np.minimum(lengths - 1, (lengths * (1.0 - steady_part)).astype(np.int64))
        self._band = band
        self._beyond = np.full(len(rows), -np.inf)
        self._inside = rows.copy()
        self._steady_sums = np.zeros(len(rows))
        self._count = 0

    def add(self, reference: Array, position: Array) -> None:
        """Add samples of x_d and x, each of shape (n,)."""
        begin, end = self._count, self._count + len(position)
        self._count = end
        first = max(0, int(np.searchsorted(self._rows, begin, side='right')) - 1)
        for step in range(first, int(np.searchsorted(self._rows, end))):
            row, height = int(self._rows[step]), float(self._heights[step])
            low, high = max(row, begin), min(int(self._ends[step]), end)
            if low >= high:
                continue
            error = position[low - begin : high - begin] - reference[low - begin]
            self._beyond[step] = np.maximum(self._beyond[step], (error / height).max())
            outside = np.flatnonzero(~(np.abs(error) <= self._band * abs(height)))
            if len(outside):
                self._inside[step] = low + int(outside[-1]) + 1
            steady = max(int(self._steady_rows[step]) - low, 0)
            self._steady_sums[step] += float(error[steady:].sum())

    def response(self, sample_time: float) -> StepResponse:
        """Return the responses to all edges."""
        settling = np.where(self._inside < self._ends, (self._inside - self._rows) * sample_time, np.inf)
        return StepResponse(
            self._rows,
            self._heights,
            100.0 * np.maximum(0.0, self._beyond),
            settling,
            self._steady_sums / (self._ends - self._steady_rows),
        )
