"""How a run can go wrong, each said in one line."""

import math
from collections.abc import Sequence

_NAMED = 5
NOT_FINITE = 'not finite at tick'
"""By this the reason of a run that a signal ended is known: part of the text of :class:`NotFiniteError`."""


class RunError(Exception):
    """A run that cannot start or go on."""


class DiskError(RunError, OSError):
    """A file of the run that cannot be written: names it, and why."""

    @classmethod
    def of(cls, error: OSError) -> 'DiskError':
        """Return the same error in one line."""
        what = error.strerror or str(error)
        return cls(f'{error.filename}: {what}' if error.filename else what)


class WriterError(RunError, RuntimeError):
    """A process that wrote the bag and has ended or hangs: says why."""


class StopRequest(Exception):
    """Somebody asked the run to end before its last tick."""


class StampError(RunError):
    """A message whose stamp is not the one of the expected tick."""

    def __init__(self, topic: str, expected: int, received: float, publishers: str) -> None:
        kind = 'out of order' if received < expected else 'ahead'
        super().__init__(
            f'{topic}: expected tick {expected}, got tick {received:.12g} ({kind}); published by {publishers}'
        )


class NotFiniteError(RunError):
    """
    A value that is not a finite number.

    Parameters
    ----------
    topic, tick, node
        Where it is, and who published it.
    values
        The numbers of the message.
    names
        Their names, of a message that has many: then those that are not finite are named, up to five.
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
    """A package of the extra ``campaign`` that is not installed."""

    exit_code = 1

    def __init__(self, what: str, package: str) -> None:
        super().__init__(f"{what} needs {package}, which is not installed: pip install 'hdd_servo_ros[campaign]'")
