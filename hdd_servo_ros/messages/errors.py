"""How a run can go wrong, each said in one line."""

NOT_FINITE = 'not finite at tick'
"""By this the reason of a run that a signal ended is known: part of the text of :class:`NotFiniteError`."""


class RunError(Exception):
    """A run that cannot start or go on."""


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
    """A value that is not a finite number."""

    def __init__(self, topic: str, tick: int, values: tuple[float, ...], node: str) -> None:
        text = ', '.join(f'{value:g}' for value in values)
        super().__init__(f'{topic}: {NOT_FINITE} {tick}: ({text}); published by {node}')
