"""Rows of signals as the messages that the nodes would publish."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdd_servo_ros.messages.cdr import Messages, row_packer, stamp_rows
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS, LoopTopic


class Packer:
    """
    Turns rows into messages, in the order in which the recorder of the graph writes them.

    Parameters
    ----------
    topics
        The topics of the run, in the recorder's order.
    sample_time
        T [s].
    frame_id
        Name of the drive, in the header of every vector.
    estimate_names
        Names of the estimates.
    """

    def __init__(
        self, topics: Sequence[LoopTopic], sample_time: float, frame_id: str, estimate_names: tuple[str, ...]
    ) -> None:
        self._topics = tuple(topics)
        self._sample_time_ns = sample_time_to_nanoseconds(sample_time)
        self._packers = {topic.name: row_packer(topic.codec, frame_id, estimate_names) for topic in self._topics}

    def pack(self, rows: SignalRows, recorded: Mapping[str, Messages]) -> tuple[list[int], list[int], list[memoryview]]:
        """
        Return topic, time [ns] and payload of every message of the rows.

        Parameters
        ----------
        rows
            The signals.
        recorded
            Messages of the same ticks that were recorded before and are passed on as they are, by their topic.
        """
        count = len(rows)
        times = np.arange(rows.first_tick, rows.first_tick + count, dtype=np.int64) * self._sample_time_ns
        stamps = stamp_rows(times)
        kinds = len(self._topics)
        payloads: list[Any] = [None] * (count * kinds)
        for index, topic in enumerate(self._topics):
            messages = recorded[topic.name] if topic.name in recorded else self._messages(topic, stamps, rows)
            size = messages.shape[1]
            flat = messages.reshape(-1).data
            payloads[index::kinds] = [flat[start : start + size] for start in range(0, count * size, size)]
        return list(range(kinds)) * count, np.repeat(times, kinds).tolist(), payloads

    def _messages(self, topic: LoopTopic, stamps: Messages, rows: SignalRows) -> Messages:
        """Return the messages of a topic, one per row."""
        values = np.empty((len(rows), 0)) if topic.codec.width == 0 else rows[topic.name]
        return self._packers[topic.name](stamps, values)


def first_not_finite(rows: SignalRows) -> tuple[LoopTopic, int, tuple[float, ...]] | None:
    """Return topic, tick and values of the first vector that is not finite, None if all are."""
    found = []
    for order, topic in enumerate(SIGNAL_TOPICS):
        if topic.is_vector and topic.name in rows:
            invalid = np.flatnonzero(~np.isfinite(rows[topic.name]).all(axis=1))
            if len(invalid):
                found.append((int(invalid[0]), order, topic))
    if not found:
        return None
    row, _, topic = min(found)
    return topic, rows.first_tick + row, tuple(rows[topic.name][row].tolist())
