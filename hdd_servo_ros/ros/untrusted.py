"""Messages that anybody may have sent, whatever their bytes are."""

from typing import Any

from rclpy.serialization import deserialize_message


class MessageError(ValueError):
    """Bytes that are not a message of the type."""


def message_of(kind: Any, message: bytes) -> Any:
    """
    Return the message of a type that some bytes hold.

    Raises
    ------
    MessageError
        If they hold none.
    """
    try:
        return deserialize_message(message, kind)
    except Exception as error:  # its class differs with what is wrong, and none is documented
        raise MessageError(f'{len(message)} bytes that are no {kind.__name__}: {type(error).__name__}') from None
