"""Decimated rows of a long run, from which its time plots look the same as from all rows."""

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.ticks import NANOSECONDS, sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import CONTROL, DISTURBANCE, ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.recording.run_stretch import joined
from hdd_servo_ros.reporting.decimation import bucket_extremes

Array = NDArray[np.float64]


class ChosenRows(SignalRows):
    """
    Selected ticks of a run with all their signals.

    Parameters
    ----------
    ticks
        The ticks, ascending, shape (n,).
    rows
        The signals at these ticks.
    row_count
        Number of ticks of the whole run.
    """

    def __init__(self, ticks: NDArray[np.int64], rows: SignalRows, row_count: int) -> None:
        names = rows.estimate_names
        super().__init__(0, rows.sample_time, {name: rows[name] for name in rows.topic_names}, names, rows.units)
        self._ticks = ticks
        self.row_count = row_count

    @functools.cached_property
    def ticks(self) -> NDArray[np.int64]:
        """The ticks, shape (n,)."""
        return self._ticks

    @functools.cached_property
    def time(self) -> Array:
        """Time of each tick [s], shape (n,)."""
        return np.asarray(self.ticks * sample_time_to_nanoseconds(self.sample_time) / NANOSECONDS)

    def with_stretches(self, *others: SignalRows) -> 'ChosenRows':
        """Return these rows together with further stretches of consecutive ticks."""
        every = np.concatenate([self.ticks, *(other.ticks for other in others)])
        ticks, first = np.unique(every, return_index=True)
        rows = joined([self, *others])
        arrays = {name: rows[name][first] for name in rows.topic_names}
        chosen = SignalRows(0, rows.sample_time, arrays, rows.estimate_names, rows.units)
        return ChosenRows(ticks, chosen, self.row_count)


class RowChooser:
    """
    Selects rows of a run block by block: the extremes of all plotted signals in each bucket of ticks.

    Parameters
    ----------
    row_count
        Number of ticks of the whole run.
    buckets
        Number of buckets of equal length.
    in_full
        Stretches of ticks in which every row is kept.
    """

    def __init__(self, row_count: int, buckets: int, in_full: Sequence[slice]) -> None:
        self._row_count = row_count
        self.size = -(-row_count // buckets)
        """Ticks per bucket; each block except the last has an integer number of buckets."""
        self._in_full = in_full
        self._buckets = buckets
        self._ticks: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._rows: SignalRows | None = None
        self._used = 0

    def add(self, block: SignalRows) -> None:
        """Select rows of the next block."""
        count, first = len(block), block.first_tick
        whole = count - count % self.size
        found = [np.arange(whole, count)]
        drawn = _drawn(block)
        if self._rows is None:
            self._make_room(block, len(drawn))
        for values in drawn:
            found += bucket_extremes(values, self.size)
        for part in self._in_full:
            found.append(np.arange(max(part.start - first, 0), min(part.stop - first, count)))
        self._take(block, np.unique(np.concatenate(found)))

    def _make_room(self, block: SignalRows, drawn: int) -> None:
        """
        Allocate arrays for the largest possible number of rows.

        Small arrays per block would fragment the memory between the blocks, which are freed.
        """
        most = 2 * drawn * self._buckets + self.size + sum(part.stop - part.start for part in self._in_full)
        most = min(most, self._row_count)
        arrays = {name: np.empty((most, block[name].shape[1])) for name in block.topic_names}
        self._rows = SignalRows(0, block.sample_time, arrays, block.estimate_names, block.units)
        self._ticks = np.empty(most, dtype=np.int64)

    def _take(self, block: SignalRows, rows: NDArray[np.int64]) -> None:
        assert self._rows is not None
        into = slice(self._used, self._used + len(rows))
        self._ticks[into] = block.first_tick + rows
        for name in block.topic_names:
            self._rows[name][into] = block[name][rows]
        self._used = into.stop

    def chosen(self) -> ChosenRows:
        """Return the selected rows."""
        assert self._rows is not None
        return ChosenRows(self._ticks[: self._used], self._rows.part(0, self._used), self._row_count)


def _drawn(block: SignalRows) -> list[Array]:
    """Return every signal that a time plot may show."""
    columns: list[Array] = []
    if HEAD.name in block:
        columns.append(block.position)
    if REFERENCE.name in block:
        columns.append(block.desired_position)
    if HEAD.name in block and REFERENCE.name in block:
        # In the precision of the plot: of two values that rounding makes equal, the first counts.
        columns.append(block.units.error_factor * block.position_error)
        if DISTURBANCE.name in block and not block.is_track_following:
            columns.append(block.units.error_factor * block.track_error)
    if CONTROL.name in block:
        columns += [block.command, block.feedback]
    if DISTURBANCE.name in block:
        columns.append(block.disturbance.force)
    if ESTIMATES.name in block:
        columns += list(block.estimates.values())
    return columns
