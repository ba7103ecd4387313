"""The columns of a bag as numbers: stamps and values of many messages of a topic at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import STAMP, array_names_and_offset, names_and_start
from hdd_servo_ros.messages.codecs import CODECS, Codec
from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.recording.bag_columns import BagError, Column


def stamps_of(column: Column, type_name: str) -> NDArray[np.int64]:
    """
    Return the time that each message carries itself [ns], shape (n,).

    Parameters
    ----------
    column
        The messages.
    type_name
        Their type: that of a loop topic.

    Raises
    ------
    BagError
        If they are arrays of different length, or of a type that no topic of the loop has.
    """
    if not len(column):
        return column.times
    codec = _codec(type_name)
    if not codec.is_stamped:
        return np.rint(_numbers(column, codec)[:, 0] * NANOSECONDS).astype(np.int64)
    heads = _part(column, slice(STAMP.start, STAMP.stop))
    stamps = np.ascontiguousarray(heads).view([('s', '<i4'), ('ns', '<u4')])[:, 0]
    times: NDArray[np.int64] = stamps['s'].astype(np.int64) * NANOSECONDS + stamps['ns']
    return times


def values_of(column: Column, type_name: str) -> NDArray[Any]:
    """
    Return what the messages of a loop topic carry: (n, 3) for vectors, (n, m) for arrays, the clock's time [ns] (n,).

    Raises
    ------
    BagError
        If they are arrays of different length, or of a type that no topic of the loop has.
    """
    codec = _codec(type_name)
    return stamps_of(column, type_name) if codec.width == 0 else _numbers(column, codec)


def array_names(column: Column) -> tuple[str, ...]:
    """Return the names of the elements of labelled arrays, by the first message."""
    return array_names_and_offset(bytes(column.payloads[0]))[0] if len(column) else ()


def _part(column: Column, part: slice) -> NDArray[np.uint8]:
    """Return a part of every payload, shape (n, size)."""
    if isinstance(column.payloads, list):
        parts = [payload[part] for payload in column.payloads]
        return np.frombuffer(b''.join(parts), dtype=np.uint8).reshape(len(parts), -1)
    return column.payloads[:, part]


def _codec(type_name: str) -> Codec:
    if type_name not in CODECS:
        raise BagError(f'messages of {type_name} are none of the loop')
    return CODECS[type_name]


def _numbers(column: Column, codec: Codec) -> NDArray[np.float64]:
    """Return the numbers at the end of every message, shape (n, m)."""
    if codec.width is None:
        if isinstance(column.payloads, list):
            raise BagError('the arrays on a topic are of different length')
        if not len(column.payloads):
            return np.zeros((0, 1))
    first = bytes(column.payloads[0]) if len(column.payloads) else b''
    _, start = names_and_start(codec, first)
    return np.ascontiguousarray(_part(column, slice(start, None))).view('<f8')
