"""
Loop messages as fixed-layout CDR bytes.

The loop's messages have the same layout at every tick, so one precomputed :class:`struct.Struct` a topic packs and
unpacks them, several times faster than a general serializer. The bytes are those of ``rclpy.serialization`` with zeros
in the padding, little-endian; the tests compare them.
"""

import functools
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.codecs import ARRAYS, CLOCKS, VECTORS, Codec
from hdd_servo_ros.messages.ticks import NANOSECONDS

Messages = NDArray[np.uint8]
RowPacker = Callable[[Messages, NDArray[np.float64]], Messages]
"""Makes messages, one a row, of stamp bytes, shape (n, 8), and numbers, shape (n, width)."""

HEADER = b'\x00\x01\x00\x00'
STAMP = slice(4, 12)
"""Where a message that begins with a stamp or a header holds its time."""


def _aligned(size: int, alignment: int) -> int:
    return -(-size // alignment) * alignment


def _string(text: str) -> bytes:
    encoded = text.encode() + b'\x00'
    return struct.pack('<I', len(encoded)) + encoded


class ClockCodec:
    """``rosgraph_msgs/Clock``."""

    stamp = STAMP

    @staticmethod
    def pack(stamp: bytes) -> bytes:
        """Return the message at ``stamp`` (eight bytes)."""
        return HEADER + stamp


class VectorCodec:
    """
    ``geometry_msgs/Vector3Stamped`` with one ``frame_id``.

    Parameters
    ----------
    frame_id
        Text of ``header.frame_id``.
    """

    stamp = STAMP

    def __init__(self, frame_id: str) -> None:
        frame = _string(frame_id)
        body = _aligned(8 + len(frame), 8)
        self._prefix = frame + bytes(body - 8 - len(frame))
        self._layout = struct.Struct(f'<4s8s{len(self._prefix)}sddd')

    def pack(self, stamp: bytes, x: float, y: float, z: float) -> bytes:
        """Return the message at ``stamp`` (eight bytes) with vector (x, y, z)."""
        return self._layout.pack(HEADER, stamp, self._prefix, x, y, z)


_VECTOR = struct.Struct('<ddd')


def unpack_vector(message: bytes) -> tuple[float, float, float]:
    """Return x, y, z of a ``Vector3Stamped``: its last 24 bytes, whatever the ``frame_id`` is."""
    return _VECTOR.unpack_from(message, len(message) - 24)


class ArrayCodec:
    """
    ``std_msgs/Float64MultiArray`` of one dimension whose label names the elements.

    Parameters
    ----------
    names
        Names of the elements; the first is ``t``, the tick's time [s], since this message type has no header.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        count = len(self.names)
        head = struct.pack('<I', 1) + _string(','.join(self.names))
        head += bytes(_aligned(len(head), 4) - len(head))
        head += struct.pack('<IIII', count, count, 0, count)
        head += bytes(_aligned(len(head), 8) - len(head))
        self._prefix = HEADER + head
        self._layout = struct.Struct(f'<{len(self._prefix)}s{count}d')
        self.stamp = slice(len(self._prefix), len(self._prefix) + 8)

    def pack(self, values: Sequence[float]) -> bytes:
        """Return the message with ``values``, one for each name."""
        return self._layout.pack(self._prefix, *values)


def array_names_and_offset(message: bytes) -> tuple[tuple[str, ...], int]:
    """
    Return the names in a one-dimensional labelled array message, and where its first element stands.

    Raises
    ------
    ValueError
        If the layout is not the one of :class:`ArrayCodec`.
    """
    dimensions, length = struct.unpack_from('<II', message, 4)
    if dimensions != 1:
        raise ValueError(f'expected one labelled dimension in the array, got {dimensions}')
    names = tuple(message[12 : 12 + length - 1].decode().split(','))
    offset = 4 + _aligned(_aligned(8 + length, 4) + 16, 8)
    (count,) = struct.unpack_from('<I', message, 4 + _aligned(8 + length, 4) + 12)
    if count != len(names):
        raise ValueError(f'the array has {count} elements and {len(names)} names')
    return names, offset


def names_and_start(codec: Codec, message: bytes) -> tuple[tuple[str, ...], int]:
    """
    Return the names of a message's numbers, and the index of their first byte, counted from the end if negative.

    Raises
    ------
    ValueError
        If a message that names its own numbers is not laid out as :class:`ArrayCodec` does.
    """
    if codec.width is None:
        return array_names_and_offset(message)
    return codec.components[: codec.width], -8 * codec.width


def numbers(codec: Codec, message: bytes) -> list[float]:
    """Return the numbers of a message that has some; raises ValueError as :func:`names_and_start` does."""
    _, start = names_and_start(codec, message)
    values: Any = memoryview(message)[start:].cast('d')
    return list(values)


def row_packer(codec: Codec, frame_id: str, names: Sequence[str]) -> RowPacker:
    """
    Return what packs many messages of a type at once.

    Parameters
    ----------
    codec
        The type.
    frame_id
        Text of ``header.frame_id``, for a type that has it.
    names
        Names of the elements, for a type that names them.

    Raises
    ------
    KeyError
        If only single messages are made of this type.
    """
    return _ROW_PACKERS[codec](frame_id, names)


def vector_rows(codec: VectorCodec, stamps: NDArray[np.uint8], values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """
    Return many vector messages at once, one a row, the same bytes as :meth:`VectorCodec.pack` gives.

    Parameters
    ----------
    codec
        The layout.
    stamps
        Stamp bytes, shape (n, 8); see :func:`stamp_rows`.
    values
        x, y, z, shape (n, 3).
    """
    return _rows(codec.pack(bytes(8), 0.0, 0.0, 0.0), codec.stamp.start, stamps, values)


def array_rows(codec: ArrayCodec, values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return many array messages at once, one a row; ``values`` has shape (n, number of names)."""
    return _rows(codec.pack([0.0] * len(codec.names)), None, None, values)


def clock_rows(stamps: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return many clock messages at once, one a row."""
    return _rows(ClockCodec.pack(bytes(8)), STAMP.start, stamps, np.empty((len(stamps), 0)))


def stamp_rows(times_ns: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the stamp bytes of times [ns], shape (n, 8)."""
    stamps = np.empty(len(times_ns), dtype=[('sec', '<i4'), ('nanosec', '<u4')])
    stamps['sec'], stamps['nanosec'] = np.divmod(times_ns, NANOSECONDS)
    return stamps.view(np.uint8).reshape(len(times_ns), 8)


def _rows(
    template: bytes, stamp_at: int | None, stamps: NDArray[np.uint8] | None, values: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Repeat a message, and write the stamps and, at its end, the values into the copies."""
    rows = np.tile(np.frombuffer(template, dtype=np.uint8), (len(values), 1))
    if stamps is not None:
        assert stamp_at is not None
        rows[:, stamp_at : stamp_at + 8] = stamps
    size = values.shape[1] * 8
    if size:
        rows[:, -size:] = np.ascontiguousarray(values, dtype='<f8').view(np.uint8).reshape(len(values), size)
    return rows


def _vector_packer(frame_id: str, _: Sequence[str]) -> RowPacker:
    return functools.partial(vector_rows, VectorCodec(frame_id))


def _array_packer(_: str, names: Sequence[str]) -> RowPacker:
    codec = ArrayCodec(names)
    return lambda _, values: array_rows(codec, values)


def _clock_packer(_: str, __: Sequence[str]) -> RowPacker:
    return lambda stamps, _: clock_rows(stamps)


_ROW_PACKERS: dict[Codec, Callable[[str, Sequence[str]], RowPacker]] = {
    CLOCKS: _clock_packer,
    VECTORS: _vector_packer,
    ARRAYS: _array_packer,
}
