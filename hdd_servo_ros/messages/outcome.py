"""Outcome of a run."""

import dataclasses
import signal

RUNNING = 'running'
FINISHED = 'finished'
INTERRUPTED = 'interrupted'
FAILED = 'failed'
RECOVERED = 'recovered'
"""Status after a crash and a repair by `recover`: complete up to its last tick."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Outcome of a run: status as in ``run.yaml``, one-line reason, and the signal that ended it, if any."""

    status: str
    reason: str = ''
    signal_number: int = 0

    @property
    def exit_code(self) -> int:
        """0 for a finished run, 1 for a failed one, 128 + signal number for an interrupted one, as in shells."""
        if self.status == FINISHED:
            return 0
        if self.status == INTERRUPTED:
            return 128 + (self.signal_number or signal.SIGINT)
        return 1


FINISHED_OUTCOME = Outcome(FINISHED)


def failed(reason: str) -> Outcome:
    """Return the outcome of a failed run."""
    return Outcome(FAILED, reason)


def interrupted(reason: str, signal_number: int) -> Outcome:
    """Return the outcome of a run that a user or a supervisor ended."""
    return Outcome(INTERRUPTED, reason, signal_number)
