"""Validation of message bytes received from other processes."""

import struct

from hdd_servo_ros.messages.cdr import array_names_and_offset
from hdd_servo_ros.messages.codecs import CLOCKS, Codec

LITTLE_ENDIAN = b'\x00\x01'
"""First bytes of a message in plain little-endian CDR; the two bytes after them are arbitrary."""
_STAMP_END = 12


def check_message(codec: Codec, message: bytes) -> None:
    """
    Reject bytes that do not have the layout of a message type.

    Raises
    ------
    ValueError
        With the reason.
    """
    if not message.startswith(LITTLE_ENDIAN):
        raise ValueError(f'{len(message)} bytes that do not start as little-endian CDR')
    try:
        expected = _size(codec, message)
    except (struct.error, IndexError, UnicodeDecodeError):
        raise ValueError(f'{len(message)} bytes are not a {codec.type_name}') from None
    if len(message) != expected:
        raise ValueError(f'{len(message)} bytes; expected {expected} for this {codec.type_name}')


def _size(codec: Codec, message: bytes) -> int:
    """Return the size of a message according to its first fields; may raise the errors of unpacking."""
    if codec.width is None:
        names, offset = array_names_and_offset(message)
        return offset + 8 * len(names)
    if codec is CLOCKS:
        return _STAMP_END
    (length,) = struct.unpack_from('<I', message, _STAMP_END)
    size = int(_STAMP_END + 4 + length)
    if codec.width:
        # Numbers are aligned relative to the end of the first four bytes.
        size += -(size - 4) % 8 + 8 * codec.width
    return size
