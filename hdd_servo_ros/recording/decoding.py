"""The columns of a bag as numbers: stamps and values of many messages of a topic at once."""

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
    Check that the messages of a loop topic are little-endian CDR and as long as what they hold.

    Parameters
    ----------
    column
        The messages.
    type_name
        Their type; of one that no topic of the loop has, nothing is known.

    Raises
    ------
    BagError
        If one is not: names its number.
    """
    codec = CODECS.get(type_name)
    if codec is None or codec is REPORTS:
        return
    if isinstance(column.payloads, list):
        shapes: dict[tuple[int, bytes], int] = {}
        for message, payload in enumerate(column.payloads):
            # What decides about the layout is the same in most messages.
            key = (len(payload), payload[:4] + payload[STAMP.stop : STAMP.stop + 4])
            if shapes.setdefault(key, message) == message or codec.width is None:
                _check_message(payload, codec, message)
        return
    rows = column.payloads
    if not len(rows):
        return
    first = bytes(rows[0])
    start = _check_message(first, codec, 0)
    # Encapsulation, and what says how long the message is: as in the first one.
    lengths = range(STAMP.stop, min(STAMP.stop + 4, start))
    columns = np.arange(start) if codec.width is None else np.array([0, 1, *lengths])
    for begin in range(0, len(rows), _ROWS_AT_ONCE):
        differs = (rows[begin : begin + _ROWS_AT_ONCE, columns] != rows[0, columns]).any(axis=1)
        for message in (begin + np.flatnonzero(differs)[:1]).tolist():
            _check_message(bytes(rows[message]), codec, message)
            raise BagError(f'message {message} is laid out in another way than the first: its names or lengths differ')


def _check_message(message: bytes, codec: Codec, number: int) -> int:
    """Check a message; return where its numbers begin, counted from its first byte."""
    if len(message) < len(HEADER):
        raise BagError(f'message {number} has {len(message)} bytes, too few for CDR')
    if message[:2] != HEADER[:2]:
        kind = 'big-endian' if message[:2] == b'\x00\x00' else f'of encapsulation 0x{message[:2].hex()}'
        raise BagError(f'message {number} is {kind}; only little-endian CDR can be read here')
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
        raise BagError(f'message {number} is no {codec.type_name}: {error}') from None
    if len(message) != size:
        raise BagError(f'message {number} has {len(message)} bytes, and a {codec.type_name} of its content has {size}')
    return start


_ROWS_AT_ONCE = 2**16


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
    """Return the names of the elements of labeled arrays, by the first message."""
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
