"""A campaign: trials from a seed, each of which ends in an outcome, and the table of them."""

import collections
import dataclasses
import random
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

HANG = 'hangs'
TRACEBACK = 'tracebacks'
ORPHAN = 'orphans'
WRONG = 'wrong verdicts'
NOT_FINITE = 'values that are not finite in a finished run'
KINDS = (HANG, TRACEBACK, ORPHAN, WRONG, NOT_FINITE)
"""What must never be; every campaign is held to none of each."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """One of :data:`KINDS`, and what was seen."""

    kind: str
    seen: str


@dataclasses.dataclass(frozen=True)
class Trial:
    """How a trial ended: in a few words, of which a campaign has some tens at most, and its faults."""

    outcome: str
    faults: Sequence[Fault] = ()


@dataclasses.dataclass(frozen=True)
class Campaign:
    """
    Many trials of one kind.

    Attributes
    ----------
    name
        By which it is chosen.
    title
        Of its section in the document.
    trials, short
        How many trials a whole campaign has, and the part in the tests.
    seconds
        Time that a whole one takes at most; what is left of it then is not tried [s].
    trial
        Makes one trial in a folder of its own; its choices come from the generator alone.
    """

    name: str
    title: str
    trials: int
    short: int
    seconds: float
    trial: Callable[[Path, random.Random], Trial]


@dataclasses.dataclass
class Result:
    """What a campaign has shown."""

    campaign: Campaign
    outcomes: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    faults: list[tuple[int, Fault]] = dataclasses.field(default_factory=list)
    """Number of the trial, by which it can be made again, and the fault."""
    seconds: float = 0.0

    @property
    def trials(self) -> int:
        """How many trials were made."""
        return self.outcomes.total()

    def count(self, kind: str) -> int:
        """Return how many faults of a kind there were."""
        return sum(fault.kind == kind for _, fault in self.faults)

    def lines(self) -> Iterable[str]:
        """Iterate over the lines of its section."""
        yield f'## {self.campaign.title}'
        yield ''
        yield f'{self.trials} of {self.campaign.trials} trials in {self.seconds:.0f} s.'
        yield ''
        yield '| outcome | trials |'
        yield '|---|---|'
        for outcome, count in sorted(self.outcomes.items()):
            yield f'| {outcome} | {count} |'
        for kind in KINDS:
            yield f'| {kind} | {self.count(kind)} |'
        yield ''


def run(
    campaign: Campaign, folder: Path, trials: int, *, first: int = 0, say: Callable[[str], None] = lambda _: None
) -> Result:
    """
    Make trials of a campaign.

    Parameters
    ----------
    campaign
        The campaign.
    folder
        Where each trial has a folder of its own.
    trials, first
        How many, and the number of the first one; the number is the seed of a trial.
    say
        Is told each fault, and from time to time how far the campaign is.
    """
    result = Result(campaign)
    started = said = time.monotonic()
    for number in range(first, first + trials):
        if time.monotonic() - started > campaign.seconds:
            break
        place = folder / f'{campaign.name}-{number}'
        place.mkdir(parents=True)
        trial = campaign.trial(place, random.Random(f'{campaign.name} {number}'))
        result.outcomes[trial.outcome] += 1
        for fault in trial.faults:
            result.faults.append((number, fault))
            say(f'{campaign.name} {number}: {fault.kind}: {fault.seen}')
        if not trial.faults:
            remove(place)
        if time.monotonic() - said > 20.0:
            said = time.monotonic()
            say(f'{campaign.name}: {result.trials} of {trials} trials, {len(result.faults)} faults')
    result.seconds = time.monotonic() - started
    return result


def remove(place: Path) -> None:
    """Remove a trial's folder; one with a fault is kept."""
    for path in sorted(place.rglob('*'), reverse=True):
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink()
    place.rmdir()
