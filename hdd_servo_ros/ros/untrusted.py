"""Deserialization of messages from untrusted publishers."""

from typing import Any

from rclpy.serialization import deserialize_message


class MessageError(ValueError):
    """Bytes that are not a message of the type."""


def message_of(kind: Any, message: bytes) -> Any:
    """
    Deserialize a message of a type.

    Raises
    ------
    MessageError
        If the bytes are not a message of the type.
    """
    try:
        return deserialize_message(message, kind)
    except Exception as error:  # the class depends on the fault, and is not documented
        raise MessageError(f'{len(message)} bytes that are not a {kind.__name__}: {type(error).__name__}') from None
