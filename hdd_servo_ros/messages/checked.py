"""Whether bytes are a message of the loop at all; for those that come from outside of this process."""

import struct

from hdd_servo_ros.messages.cdr import array_names_and_offset
from hdd_servo_ros.messages.codecs import CLOCKS, Codec

LITTLE_ENDIAN = b'\x00\x01'
"""How a message of plain little-endian CDR begins; the two bytes behind it are free."""
_STAMP_END = 12


def check_message(codec: Codec, message: bytes) -> None:
    """
    Reject bytes that are not laid out as a type's messages are.

    Raises
    ------
    ValueError
        Says what is wrong.
    """
    if not message.startswith(LITTLE_ENDIAN):
        raise ValueError(f'{len(message)} bytes that do not begin as little-endian CDR')
    try:
        expected = _size(codec, message)
    except (struct.error, IndexError, UnicodeDecodeError):
        raise ValueError(f'{len(message)} bytes are no {codec.type_name}') from None
    if len(message) != expected:
        raise ValueError(f'{len(message)} bytes, a {codec.type_name} of this kind has {expected}')


def _size(codec: Codec, message: bytes) -> int:
    """Return how long a message is by what its beginning says; may raise what unpacking does."""
    if codec.width is None:
        names, offset = array_names_and_offset(message)
        return offset + 8 * len(names)
    if codec is CLOCKS:
        return _STAMP_END
    (length,) = struct.unpack_from('<I', message, _STAMP_END)
    size = int(_STAMP_END + 4 + length)
    if codec.width:
        # Numbers are aligned from the end of the first four bytes.
        size += -(size - 4) % 8 + 8 * codec.width
    return size
