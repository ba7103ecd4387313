"""A campaign: trials from a seed, each of which ends in an outcome, and the table of them."""

import collections
import dataclasses
import itertools
import random
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

HANG = 'hangs'
TRACEBACK = 'tracebacks'
ORPHAN = 'orphans'
WRONG = 'wrong verdicts'
NOT_FINITE = 'values that are not finite in a finished run'
KINDS = (HANG, TRACEBACK, ORPHAN, WRONG, NOT_FINITE)
"""What must never be; every campaign is held to none of each."""
SAID_EVERY = 20.0
"""Time between two lines that tell how far a campaign is [s]."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """One of :data:`KINDS`, and what was seen."""

    kind: str
    seen: str


@dataclasses.dataclass(frozen=True)
class Trial:
    """
    How a trial ended.

    Attributes
    ----------
    outcome
        In a few words, of which a campaign has some tens at most.
    faults
        What must not be.
    counts
        How often what happened in it, where it tries many things; a campaign has the sums.
    figures
        What was measured in it, with the unit in the name; a campaign has the largest of each.
    """

    outcome: str
    faults: Sequence[Fault] = ()
    counts: Mapping[str, int] = dataclasses.field(default_factory=dict)
    figures: Mapping[str, float] = dataclasses.field(default_factory=dict)


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
    trial_seconds
        Time after which a trial that does not return by itself is ended, and counts as a hang [s].
    jobs
        How many trials are made at a time at most.
    trial
        Makes one trial in a folder of its own; its choices come from the generator alone.
    """

    name: str
    title: str
    trials: int
    short: int
    seconds: float
    trial: Callable[[Path, random.Random], Trial]
    trial_seconds: float = 1500.0
    jobs: int = 2


@dataclasses.dataclass
class Result:
    """What a campaign has shown."""

    campaign: Campaign
    outcomes: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    counts: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    figures: dict[str, float] = dataclasses.field(default_factory=dict)
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

    def add(self, number: int, trial: Trial) -> None:
        """Take a trial into account."""
        self.outcomes[trial.outcome] += 1
        self.counts.update(trial.counts)
        for name, figure in trial.figures.items():
            self.figures[name] = max(figure, self.figures.get(name, figure))
        self.faults += [(number, fault) for fault in trial.faults]

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
        if self.counts:
            yield '| in these trials | number |'
            yield '|---|---|'
            for name, count in sorted(self.counts.items()):
                yield f'| {name} | {count} |'
            yield ''
        if self.figures:
            yield '| largest | |'
            yield '|---|---|'
            for name, figure in sorted(self.figures.items()):
                yield f'| {name} | {figure:.4g} |'
            yield ''


Made = Callable[[Campaign, Path, Iterator[int]], Iterator[tuple[int, Trial]]]
"""Makes trials of these numbers, and gives each as it ends."""


def one_by_one(campaign: Campaign, folder: Path, numbers: Iterator[int]) -> Iterator[tuple[int, Trial]]:
    """Make trials in this process; what the judge itself raises goes on."""
    for number in numbers:
        yield number, make(campaign, folder, number)


def make(campaign: Campaign, folder: Path, number: int) -> Trial:
    """Make one trial; its folder is kept if it has a fault."""
    directory = folder / f'{campaign.name}-{number}'
    directory.mkdir(parents=True)
    trial = campaign.trial(directory, random.Random(f'{campaign.name} {number}'))
    if not trial.faults:
        remove(directory)
    return trial


def judged(campaign: Campaign, folder: Path, number: int) -> Trial:
    """Make one trial as :func:`make` does; what the judge itself raises is a fault."""
    try:
        return make(campaign, folder, number)
    except Exception:
        return Trial('not judged', [Fault(WRONG, traceback.format_exc())])


def run(
    campaign: Campaign,
    folder: Path,
    trials: int,
    *,
    first: int = 0,
    say: Callable[[str], None] = lambda _: None,
    made: Made = one_by_one,
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
    made
        How they are made.
    """
    result = Result(campaign)
    started = said = time.monotonic()
    in_time = itertools.takewhile(
        lambda _: time.monotonic() - started <= campaign.seconds, range(first, first + trials)
    )
    for number, trial in made(campaign, folder, in_time):
        result.add(number, trial)
        for fault in trial.faults:
            say(f'{campaign.name} {number}: {fault.kind}: {fault.seen}')
        if time.monotonic() - said > SAID_EVERY:
            said = time.monotonic()
            left = min((said - started) / result.trials * (trials - result.trials), started + campaign.seconds - said)
            say(
                f'{campaign.name}: {result.trials} of {trials} trials, {len(result.faults)} faults, '
                f'about {max(left, 0.0) / 60.0:.1f} min left'
            )
    result.seconds = time.monotonic() - started
    return result


def remove(directory: Path) -> None:
    """Remove a trial's folder; one with a fault is kept."""
    for path in sorted(directory.rglob('*'), reverse=True):
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink()
    directory.rmdir()
