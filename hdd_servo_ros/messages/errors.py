"""Errors of a run, each with a one-line message."""

import math
from collections.abc import Sequence

_NAMED = 5
NOT_FINITE = 'not finite at tick'
"""Part of the message of :class:`NotFiniteError`; identifies runs that ended with a non-finite signal."""


class RunError(Exception):
    """Run that cannot start or continue."""


class DiskError(RunError, OSError):
    """File of the run that cannot be written; the message has its name and the reason."""

    @classmethod
    def of(cls, error: OSError) -> 'DiskError':
        """Return the same error with a one-line message."""
        what = error.strerror or str(error)
        return cls(f'{error.filename}: {what}' if error.filename else what)


class WriterError(RunError, RuntimeError):
    """Writer process of the bag that has ended or does not respond; the message has the reason."""


class StopRequest(Exception):
    """Request to end the run before its last tick."""


class StampError(RunError):
    """Message whose stamp differs from that of the expected tick."""

    def __init__(self, topic: str, expected: int, received: float, publishers: str) -> None:
        kind = 'out of order' if received < expected else 'ahead'
        super().__init__(
            f'{topic}: expected tick {expected}, got tick {received:.12g} ({kind}); published by {publishers}'
        )


class NotFiniteError(RunError):
    """
    Value that is not a finite number.

    Parameters
    ----------
    topic, tick, node
        Topic and tick of the message, and the node that published it.
    values
        Numbers of the message.
    names
        Names of the numbers, for a message with many; the error then lists up to five that are not finite.
    """

    def __init__(self, topic: str, tick: int, values: Sequence[float], node: str, names: Sequence[str] = ()) -> None:
        text = ', '.join(f'{value:g}' for value in values)
        if names:
            wrong = [
                f'{name} = {value:g}' for name, value in zip(names, values, strict=True) if not math.isfinite(value)
            ]
            text = ', '.join(wrong[:_NAMED]) + (f' and {len(wrong) - _NAMED} more' if len(wrong) > _NAMED else '')
        super().__init__(f'{topic}: {NOT_FINITE} {tick}: ({text}); published by {node}')


class MissingExtra(RuntimeError):
    """Missing package of the extra ``campaign``."""

    exit_code = 1

    def __init__(self, what: str, package: str) -> None:
        super().__init__(f"{what} needs {package}, which is not installed: pip install 'hdd_servo_ros[campaign]'")
