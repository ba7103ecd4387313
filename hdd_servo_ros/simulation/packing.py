"""Packing of signal rows into the messages that the nodes would publish."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import RowLayout, row_layout, stamp_rows
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.tick_messages import Messages
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS, LoopTopic


class Packer:
    """
    Packer of rows into messages, in the order in which the recorder node writes them.

    Parameters
    ----------
    topics
        Topics of the run, in the order of the recorder.
    sample_time
        T [s].
    frame_id
        Name of the drive, for the header of every vector message.
    estimate_names
        Names of the estimates.
    """

    def __init__(
        self, topics: Sequence[LoopTopic], sample_time: float, frame_id: str, estimate_names: tuple[str, ...]
    ) -> None:
        self._topics = tuple(topics)
        self._sample_time_ns = sample_time_to_nanoseconds(sample_time)
        self._layouts = {topic.name: row_layout(topic.codec, frame_id, estimate_names) for topic in self._topics}

    def pack(self, rows: SignalRows, recorded: Mapping[str, Messages]) -> 'PackedRows':
        """
        Return the messages of the rows.

        Parameters
        ----------
        rows
            Signals; they must not change until the messages are written.
        recorded
            Previously recorded messages of the same ticks, which are passed on unchanged, by topic.
        """
        times = np.arange(rows.first_tick, rows.first_tick + len(rows), dtype=np.int64) * self._sample_time_ns
        return PackedRows(times, [self._column(topic, rows, recorded) for topic in self._topics])

    def _column(
        self, topic: LoopTopic, rows: SignalRows, recorded: Mapping[str, Messages]
    ) -> 'tuple[RowLayout, NDArray[np.float64]] | Messages':
        if topic.name in recorded:
            return recorded[topic.name]
        values = np.empty((len(rows), 0)) if topic.codec.width == 0 else rows[topic.name]
        return self._layouts[topic.name], values


class PackedRows:
    """
    Messages of ticks, packed when they are written; see :class:`hdd_servo_ros.messages.tick_messages.TickMessages`.

    Parameters
    ----------
    times
        Time of each tick [ns].
    columns
        For each topic, the layout and the values of each message, or the messages themselves.
    """

    def __init__(
        self, times: NDArray[np.int64], columns: Sequence[tuple[RowLayout, NDArray[np.float64]] | Messages]
    ) -> None:
        self._times = times
        self._columns = columns

    @property
    def times(self) -> NDArray[np.int64]:
        """Receive time of the messages of each tick [ns], shape (n,)."""
        return self._times

    @property
    def templates(self) -> list[bytes]:
        """Template message of each topic, with the right size and the constant bytes."""
        return [column[0].template if isinstance(column, tuple) else bytes(column.shape[1]) for column in self._columns]

    def fill(self, ticks: slice, payloads: Sequence[Messages]) -> None:
        """Fill copies of the templates for a slice of the ticks."""
        stamps = stamp_rows(self._times[ticks])
        for column, messages in zip(self._columns, payloads, strict=True):
            if isinstance(column, tuple):
                layout, values = column
                layout.fill(messages, stamps, values[ticks])
            else:
                messages[:] = column[ticks]


def first_not_finite(rows: SignalRows) -> tuple[LoopTopic, int, tuple[float, ...]] | None:
    """Return topic, tick and values of the first message that is not finite, or None if all are finite."""
    found = []
    for order, topic in enumerate(SIGNAL_TOPICS):
        # Check all values at once first, which is many times faster than row by row.
        if topic.name in rows and not np.isfinite(rows[topic.name]).all():
            invalid = np.flatnonzero(~np.isfinite(rows[topic.name]).all(axis=1))
            if len(invalid):
                found.append((int(invalid[0]), order, topic))
    if not found:
        return None
    row, _, topic = min(found)
    return topic, rows.first_tick + row, tuple(rows[topic.name][row].tolist())
