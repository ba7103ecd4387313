"""
Loop messages as fixed-layout CDR bytes.

The loop's messages have the same layout at every tick, so one precomputed :class:`struct.Struct` per topic packs and
unpacks them, several times faster than a general serializer. The bytes equal those of ``rclpy.serialization`` with
zeros in the padding, little-endian; the tests compare them.
"""

import dataclasses
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.codecs import ACCELERATIONS, ARRAYS, CLOCKS, VECTORS, Codec
from hdd_servo_ros.messages.tick_messages import Messages
from hdd_servo_ros.messages.ticks import NANOSECONDS

HEADER = b'\x00\x01\x00\x00'
STAMP = slice(4, 12)
"""Offset of the time in a message that starts with a stamp or a header."""


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


class ReportCodec:
    """
    ``std_msgs/Header`` with a fixed ``frame_id``.

    Parameters
    ----------
    frame_id
        The ``frame_id``.
    """

    def __init__(self, frame_id: str) -> None:
        self._text = _string(frame_id)

    def pack(self, stamp: bytes) -> bytes:
        """Return the message at ``stamp`` (eight bytes)."""
        return HEADER + stamp + self._text

    def stamp_of(self, message: bytes) -> bytes | None:
        """Return the stamp of a message with this ``frame_id``, None for any other bytes."""
        end = STAMP.stop + len(self._text)
        # DDS may append up to three bytes of padding.
        is_own = message[:2] == HEADER[:2] and message[STAMP.stop : end] == self._text
        return message[STAMP] if is_own and len(message) < end + 4 else None


class _StampedCodec:
    """
    Message of a header with a fixed ``frame_id``, and numbers.

    Parameters
    ----------
    frame_id
        The ``header.frame_id``.
    """

    stamp = STAMP
    _width: int
    """Number of float64 values."""

    def __init__(self, frame_id: str) -> None:
        frame = _string(frame_id)
        self._prefix = frame + bytes(_aligned(8 + len(frame), 8) - 8 - len(frame))
        self._layout = struct.Struct(f'<4s8s{len(self._prefix)}s{self._width}d')


class VectorCodec(_StampedCodec):
    """``geometry_msgs/Vector3Stamped`` with a fixed ``frame_id``."""

    _width = 3

    def pack(self, stamp: bytes, x: float, y: float, z: float) -> bytes:
        """Return the message at ``stamp`` (eight bytes) with vector (x, y, z)."""
        return self._layout.pack(HEADER, stamp, self._prefix, x, y, z)


class AccelerationCodec(_StampedCodec):
    """``geometry_msgs/AccelStamped`` with a fixed ``frame_id``."""

    _width = 6

    def pack(self, stamp: bytes, linear: Sequence[float], angular: Sequence[float]) -> bytes:
        """Return the message at ``stamp`` (eight bytes) with linear and angular acceleration, each (x, y, z)."""
        return self._layout.pack(HEADER, stamp, self._prefix, *linear, *angular)


_VECTOR = struct.Struct('<ddd')


def unpack_vector(message: bytes) -> tuple[float, float, float]:
    """Return x, y, z of a ``Vector3Stamped``: its last 24 bytes, for any ``frame_id``."""
    return _VECTOR.unpack_from(message, -24)


_ACCELERATIONS = struct.Struct('<dddddd')


def unpack_accelerations(message: bytes) -> tuple[float, float, float, float, float, float]:
    """Return linear x, y, z and angular x, y, z of an ``AccelStamped``: its last 48 bytes."""
    return _ACCELERATIONS.unpack_from(message, len(message) - 48)


class ArrayCodec:
    """
    One-dimensional ``std_msgs/Float64MultiArray`` whose label names the elements.

    Parameters
    ----------
    names
        Names of the elements. The first is ``t``, the time of the tick [s], since this message type has no header.
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
        """Return the message with ``values``, one per name."""
        return self._layout.pack(self._prefix, *values)

    def pack_array(self, values: NDArray[np.float64]) -> bytes:
        """Return the message with the values of a float64 array; several times faster than :meth:`pack`."""
        return self._prefix + values.tobytes()


def array_names_and_offset(message: bytes) -> tuple[tuple[str, ...], int]:
    """
    Return the names in a one-dimensional labeled array message, and the offset of its first element.

    Raises
    ------
    ValueError
        If the layout differs from that of :class:`ArrayCodec`.
    """
    dimensions, length = struct.unpack_from('<II', message, 4)
    if dimensions != 1:
        raise ValueError(f'expected one labeled dimension in the array, got {dimensions}')
    names = tuple(message[12 : 12 + length - 1].decode().split(','))
    offset = 4 + _aligned(_aligned(8 + length, 4) + 16, 8)
    (count,) = struct.unpack_from('<I', message, 4 + _aligned(8 + length, 4) + 12)
    if count != len(names):
        raise ValueError(f'the array has {count} elements and {len(names)} names')
    return names, offset


def names_and_start(codec: Codec, message: bytes) -> tuple[tuple[str, ...], int]:
    """
    Return the names of a message's numbers and the offset of their first byte, counted from the end if negative.

    Raises
    ------
    ValueError
        If a message that names its own numbers does not have the layout of :class:`ArrayCodec`.
    """
    if codec.width is None:
        return array_names_and_offset(message)
    return codec.components[: codec.width], -8 * codec.width


def numbers(codec: Codec, message: bytes) -> list[float]:
    """Return the numbers of a message with numbers; raises ValueError as :func:`names_and_start` does."""
    _, start = names_and_start(codec, message)
    values: Any = memoryview(message)[start:].cast('d')
    return list(values)


@dataclasses.dataclass(frozen=True)
class RowLayout:
    """
    Layout for packing many messages of a type at once, with the same bytes as from the type's codec.

    Attributes
    ----------
    template
        A message.
    stamp_at
        Offset of its time; None if the time is among its numbers.
    width
        Number of float64 values at its end.
    """

    template: bytes
    stamp_at: int | None
    width: int

    def fill(self, messages: Messages, stamps: NDArray[np.uint8], values: NDArray[np.float64]) -> None:
        """
        Fill in copies of the template.

        Parameters
        ----------
        messages
            The copies, shape (n, size); the rows need not be contiguous.
        stamps
            Stamp bytes, shape (n, 8); see :func:`stamp_rows`.
        values
            Numbers of the messages, shape (n, width).
        """
        if self.stamp_at is not None:
            messages[:, self.stamp_at : self.stamp_at + 8].view('<u8')[:, 0] = stamps.view('<u8')[:, 0]
        if self.width:
            numbers = messages[:, -8 * self.width :].view('<f8')
            # By columns: a row is too short for a loop of its own.
            for column in range(self.width):
                numbers[:, column] = values[:, column]


def row_layout(codec: Codec, frame_id: str, names: Sequence[str]) -> RowLayout:
    """
    Return the layout for packing many messages of a type at once.

    Parameters
    ----------
    codec
        The type.
    frame_id
        The ``header.frame_id``, for types that have it.
    names
        Names of the elements, for types that name them.

    Raises
    ------
    KeyError
        If the type is packed message by message only.
    """
    return _ROW_LAYOUTS[codec](frame_id, names)


def stamp_rows(times_ns: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the stamp bytes of times [ns], shape (n, 8)."""
    stamps = np.empty(len(times_ns), dtype=[('sec', '<i4'), ('nanosec', '<u4')])
    stamps['sec'], stamps['nanosec'] = np.divmod(times_ns, NANOSECONDS)
    return stamps.view(np.uint8).reshape(len(times_ns), 8)


def _vector_layout(frame_id: str, _: Sequence[str]) -> RowLayout:
    return RowLayout(VectorCodec(frame_id).pack(bytes(8), 0.0, 0.0, 0.0), STAMP.start, 3)


def _acceleration_layout(frame_id: str, _: Sequence[str]) -> RowLayout:
    return RowLayout(AccelerationCodec(frame_id).pack(bytes(8), (0.0,) * 3, (0.0,) * 3), STAMP.start, 6)


def _array_layout(_: str, names: Sequence[str]) -> RowLayout:
    return RowLayout(ArrayCodec(names).pack([0.0] * len(names)), None, len(names))


def _clock_layout(_: str, __: Sequence[str]) -> RowLayout:
    return RowLayout(ClockCodec.pack(bytes(8)), STAMP.start, 0)


_ROW_LAYOUTS: dict[Codec, Callable[[str, Sequence[str]], RowLayout]] = {
    CLOCKS: _clock_layout,
    VECTORS: _vector_layout,
    ACCELERATIONS: _acceleration_layout,
    ARRAYS: _array_layout,
}
