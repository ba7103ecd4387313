"""The messages of consecutive ticks as signals."""

from collections.abc import Sequence

import numpy as np

from hdd_servo_ros.messages.cdr import array_names_and_offset
from hdd_servo_ros.messages.signals import Array, SignalRows
from hdd_servo_ros.messages.topics import AXES, ESTIMATES, LoopTopic

_VECTOR_SIZE = 8 * len(AXES)
"""The numbers at the end of a vector message [bytes]."""


def signals_of_messages(
    first_tick: int, sample_time: float, topics: Sequence[LoopTopic], ticks: Sequence[Sequence[bytes]]
) -> SignalRows:
    """
    Return the signals that messages carry.

    Parameters
    ----------
    first_tick, sample_time
        The first tick, and T [s].
    topics
        The topics, in the order of the messages of a tick; ``/estimates`` among them.
    ticks
        For each tick its messages.
    """
    arrays: dict[str, Array] = {}
    names: tuple[str, ...] = ()
    for index, topic in enumerate(topics):
        if topic.is_vector:
            arrays[topic.name] = _doubles([messages[index][-_VECTOR_SIZE:] for messages in ticks])
        elif topic is ESTIMATES:
            names, offset = array_names_and_offset(ticks[0][index])
            arrays[topic.name] = _doubles([messages[index][offset:] for messages in ticks])
    return SignalRows(first_tick, sample_time, arrays, names)


def _doubles(parts: Sequence[bytes]) -> Array:
    """Return the numbers of each part as a row."""
    return np.frombuffer(b''.join(parts), dtype='<f8').reshape(len(parts), -1)
