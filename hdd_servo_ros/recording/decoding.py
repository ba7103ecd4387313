"""Decoding of columns of a bag: stamps and values of many messages of a topic at once."""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.cdr import HEADER, STAMP, array_names_and_offset, names_and_start
from hdd_servo_ros.messages.codecs import CODECS, REPORTS, Codec
from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.recording.bag_columns import BagError, Column


def check_layout(column: Column, type_name: str) -> None:
    """
    Check that the messages of a loop topic are little-endian CDR of the length required by their content.

    Parameters
    ----------
    column
        Messages of the topic.
    type_name
        Type of the messages; types of other than loop topics are not checked.

    Raises
    ------
    BagError
        If a message is invalid; the text contains its number.
    """
    codec = CODECS.get(type_name)
    if codec is None or codec is REPORTS:
        return
    if isinstance(column.payloads, list):
        shapes: dict[tuple[int, bytes], int] = {}
        for message, payload in enumerate(column.payloads):
            # Most messages have the same layout.
            key = (len(payload), payload[:4] + payload[STAMP.stop : STAMP.stop + 4])
            if shapes.setdefault(key, message) == message or codec.width is None:
                _check_message(payload, codec, message)
        return
    rows = column.payloads
    if not len(rows):
        return
    first = bytes(rows[0])
    start = _check_message(first, codec, 0)
    # Encapsulation and length fields must equal those of the first message.
    lengths = range(STAMP.stop, min(STAMP.stop + 4, start))
    columns = np.arange(start) if codec.width is None else np.array([0, 1, *lengths])
    for begin in range(0, len(rows), _ROWS_AT_ONCE):
        differs = (rows[begin : begin + _ROWS_AT_ONCE, columns] != rows[0, columns]).any(axis=1)
        for message in (begin + np.flatnonzero(differs)[:1]).tolist():
            _check_message(bytes(rows[message]), codec, message)
            raise BagError(f'message {message} has another layout than the first: its names or lengths differ')


def _check_message(message: bytes, codec: Codec, number: int) -> int:
    """Check a message; return the offset of its numbers from the first byte."""
    if len(message) < len(HEADER):
        raise BagError(f'message {number} has {len(message)} bytes, too few for CDR')
    if message[:2] != HEADER[:2]:
        kind = 'big-endian' if message[:2] == b'\x00\x00' else f'of encapsulation 0x{message[:2].hex()}'
        raise BagError(f'message {number} is {kind}; expected little-endian CDR')
    try:
        if codec.width is None:
            names, start = array_names_and_offset(message)
            size = start + 8 * len(names)
        else:
            start = STAMP.stop
            if codec.width:
                (length,) = struct.unpack_from('<I', message, STAMP.stop)
                start = 4 + -(-(STAMP.stop + length) // 8) * 8
            size = start + 8 * codec.width
    except (struct.error, ValueError) as error:
        raise BagError(f'message {number} is not a {codec.type_name}: {error}') from None
    if len(message) != size:
        raise BagError(
            f'message {number} has {len(message)} bytes; expected {size} for a {codec.type_name} with its content'
        )
    return start


_ROWS_AT_ONCE = 2**16


def stamps_of(column: Column, type_name: str) -> NDArray[np.int64]:
    """
    Return the time stamp in each message [ns], shape (n,).

    Parameters
    ----------
    column
        Messages of the topic.
    type_name
        Type of the messages, that of a loop topic.

    Raises
    ------
    BagError
        If the messages are arrays of different length, or their type is not that of a loop topic.
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
    Return the values in messages of a loop topic: (n, 3) for vectors, (n, m) for arrays, times [ns] (n,) for the clock.

    Raises
    ------
    BagError
        If the messages are arrays of different length, or their type is not that of a loop topic.
    """
    codec = _codec(type_name)
    return stamps_of(column, type_name) if codec.width == 0 else _numbers(column, codec)


def array_names(column: Column) -> tuple[str, ...]:
    """Return the names of the elements of labeled arrays, from the first message."""
    return array_names_and_offset(bytes(column.payloads[0]))[0] if len(column) else ()


def _part(column: Column, part: slice) -> NDArray[np.uint8]:
    """Return a part of every payload, shape (n, size)."""
    if isinstance(column.payloads, list):
        parts = [payload[part] for payload in column.payloads]
        return np.frombuffer(b''.join(parts), dtype=np.uint8).reshape(len(parts), -1)
    return column.payloads[:, part]


def _codec(type_name: str) -> Codec:
    if type_name not in CODECS:
        raise BagError(f'{type_name} is not the type of a loop topic')
    return CODECS[type_name]


def _numbers(column: Column, codec: Codec) -> NDArray[np.float64]:
    """Return the numbers at the end of every message, shape (n, m)."""
    if codec.width is None:
        if isinstance(column.payloads, list):
            raise BagError('the arrays on a topic have different lengths')
        if not len(column.payloads):
            return np.zeros((0, 1))
    first = bytes(column.payloads[0]) if len(column.payloads) else b''
    _, start = names_and_start(codec, first)
    return np.ascontiguousarray(_part(column, slice(start, None))).view('<f8')
