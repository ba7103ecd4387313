"""The columns of a bag as numbers: stamps and values of many messages of a topic at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import STAMP, array_names_and_offset
from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.messages.topics import ARRAY_TYPE, CLOCK_TYPE
from hdd_servo_ros.recording.bag_columns import BagError, Column

_VECTOR_SIZE = 24
"""Three float64 at the end of a vector message [bytes]."""


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
        If they are arrays of different length.
    """
    if not len(column):
        return column.times
    if type_name == ARRAY_TYPE:
        return np.rint(_array_values(column)[:, 0] * NANOSECONDS).astype(np.int64)
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
        If they are arrays of different length.
    """
    if type_name == CLOCK_TYPE:
        return stamps_of(column, type_name)
    if type_name == ARRAY_TYPE:
        return _array_values(column)
    return np.ascontiguousarray(_part(column, slice(-_VECTOR_SIZE, None))).view('<f8')


def array_names(column: Column) -> tuple[str, ...]:
    """Return the names of the elements of labelled arrays, by the first message."""
    return array_names_and_offset(bytes(column.payloads[0]))[0] if len(column) else ()


def _part(column: Column, part: slice) -> NDArray[np.uint8]:
    """Return a part of every payload, shape (n, size)."""
    if isinstance(column.payloads, list):
        parts = [payload[part] for payload in column.payloads]
        return np.frombuffer(b''.join(parts), dtype=np.uint8).reshape(len(parts), -1)
    return column.payloads[:, part]


def _array_values(column: Column) -> NDArray[np.float64]:
    """Return the elements of labelled arrays, shape (n, m)."""
    payloads = column.payloads
    if isinstance(payloads, list):
        raise BagError('the arrays on a topic are of different length')
    if not len(payloads):
        return np.zeros((0, 1))
    _, offset = array_names_and_offset(payloads[0].tobytes())
    return np.ascontiguousarray(payloads[:, offset:]).view('<f8')
