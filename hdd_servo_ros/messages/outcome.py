"""How a run ends."""

import dataclasses
import signal

RUNNING = 'running'
FINISHED = 'finished'
INTERRUPTED = 'interrupted'
FAILED = 'failed'
RECOVERED = 'recovered'
"""Ended by a crash, and repaired by `recover`: whole up to its last tick."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a run ended: status as in ``run.yaml``, the reason in one line, and the signal if one ended it."""

    status: str
    reason: str = ''
    signal_number: int = 0

    @property
    def exit_code(self) -> int:
        """0 for a finished run, 1 for a failed one, 128 + signal number for an interrupted one, as shells have it."""
        if self.status == FINISHED:
            return 0
        if self.status == INTERRUPTED:
            return 128 + (self.signal_number or signal.SIGINT)
        return 1


FINISHED_OUTCOME = Outcome(FINISHED)


def failed(reason: str) -> Outcome:
    """Return the outcome of a run that went wrong."""
    return Outcome(FAILED, reason)


def interrupted(reason: str, signal_number: int) -> Outcome:
    """Return the outcome of a run that a person or a supervisor ended."""
    return Outcome(INTERRUPTED, reason, signal_number)
