"""Conversion of the messages of consecutive ticks to signals."""

from collections.abc import Sequence

import numpy as np

from hdd_servo_ros.messages.cdr import names_and_start
from hdd_servo_ros.messages.signals import Array, SignalRows
from hdd_servo_ros.messages.topics import ESTIMATES, LoopTopic


def signals_of_messages(
    first_tick: int, sample_time: float, topics: Sequence[LoopTopic], ticks: Sequence[Sequence[bytes]]
) -> SignalRows:
    """
    Return the signals in messages.

    Parameters
    ----------
    first_tick, sample_time
        First tick, and T [s].
    topics
        Topics in the order of the messages of a tick, including ``/estimates``.
    ticks
        Messages of each tick.
    """
    arrays: dict[str, Array] = {}
    names: tuple[str, ...] = ()
    for index, topic in enumerate(topics):
        if topic.codec.width == 0:
            continue
        own_names, start = names_and_start(topic.codec, ticks[0][index])
        arrays[topic.name] = _doubles([messages[index][start:] for messages in ticks])
        if topic is ESTIMATES:
            names = own_names
    return SignalRows(first_tick, sample_time, arrays, names)


def _doubles(parts: Sequence[bytes]) -> Array:
    """Return the numbers of each part as a row."""
    return np.frombuffer(b''.join(parts), dtype='<f8').reshape(len(parts), -1)
