"""Campaigns of seeded trials, and the table of their outcomes."""

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
"""Kinds of faults; a campaign passes if it finds no fault of any kind."""
PROGRESS_INTERVAL = 20.0
"""Time between two lines that report the progress of a campaign [s]."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """A fault: one of :data:`KINDS`, with a description."""

    kind: str
    message: str


@dataclasses.dataclass(frozen=True)
class Trial:
    """
    Result of a trial.

    Attributes
    ----------
    outcome
        Short description; a campaign has at most some tens of different ones.
    faults
        Faults that were found.
    counts
        Counters of a trial with many steps; a campaign adds them up.
    figures
        Measured values, with the unit in the name; a campaign keeps the largest of each.
    """

    outcome: str
    faults: Sequence[Fault] = ()
    counts: Mapping[str, int] = dataclasses.field(default_factory=dict)
    figures: Mapping[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Campaign:
    """
    A series of trials of one kind.

    Attributes
    ----------
    name
        Name on the command line.
    title
        Heading of its section in the document.
    trials, short
        Number of trials of a complete campaign, and of the tests.
    seconds
        Time limit of a complete campaign; the remaining trials are skipped [s].
    trial_seconds
        Time limit of a trial; it is then killed and counts as a hang [s].
    jobs
        Largest number of parallel trials.
    trial
        Function that makes one trial in the given directory; all its choices come from the generator.
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
    """Results of a campaign."""

    campaign: Campaign
    outcomes: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    counts: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    figures: dict[str, float] = dataclasses.field(default_factory=dict)
    faults: list[tuple[int, Fault]] = dataclasses.field(default_factory=list)
    """Number of the trial, with which it can be repeated, and the fault."""
    seconds: float = 0.0

    @property
    def trials(self) -> int:
        """Number of trials made."""
        return self.outcomes.total()

    def count(self, kind: str) -> int:
        """Return the number of faults of a kind."""
        return sum(fault.kind == kind for _, fault in self.faults)

    def add(self, number: int, trial: Trial) -> None:
        """Add a trial."""
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
            yield '| counted in these trials | number |'
            yield '|---|---|'
            for name, count in sorted(self.counts.items()):
                yield f'| {name} | {count} |'
            yield ''
        if self.figures:
            yield '| largest value | |'
            yield '|---|---|'
            for name, figure in sorted(self.figures.items()):
                yield f'| {name} | {figure:.4g} |'
            yield ''


Runner = Callable[[Campaign, Path, Iterator[int]], Iterator[tuple[int, Trial]]]
"""Makes the trials with the given numbers, and yields each as it ends."""


def sequential(campaign: Campaign, folder: Path, numbers: Iterator[int]) -> Iterator[tuple[int, Trial]]:
    """Make trials one by one in this process; exceptions of the check itself propagate."""
    for number in numbers:
        yield number, make(campaign, folder, number)


def make(campaign: Campaign, folder: Path, number: int) -> Trial:
    """Make one trial; its directory is kept if it has a fault."""
    directory = folder / f'{campaign.name}-{number}'
    directory.mkdir(parents=True)
    trial = campaign.trial(directory, random.Random(f'{campaign.name} {number}'))
    if not trial.faults:
        remove(directory)
    return trial


def judged(campaign: Campaign, folder: Path, number: int) -> Trial:
    """Make one trial as :func:`make` does; an exception of the check itself is a fault."""
    try:
        return make(campaign, folder, number)
    except Exception:
        return Trial('not checked', [Fault(WRONG, traceback.format_exc())])


def run(
    campaign: Campaign,
    folder: Path,
    trials: int,
    *,
    first: int = 0,
    log: Callable[[str], None] = lambda _: None,
    runner: Runner = sequential,
) -> Result:
    """
    Make trials of a campaign.

    Parameters
    ----------
    campaign
        The campaign.
    folder
        Parent of the directories of the trials.
    trials, first
        Number of trials, and number of the first one; its number is the seed of a trial.
    log
        Called with each fault and, at intervals, with the progress.
    runner
        Makes the trials.
    """
    result = Result(campaign)
    started = logged = time.monotonic()
    in_time = itertools.takewhile(
        lambda _: time.monotonic() - started <= campaign.seconds, range(first, first + trials)
    )
    for number, trial in runner(campaign, folder, in_time):
        result.add(number, trial)
        for fault in trial.faults:
            log(f'{campaign.name} {number}: {fault.kind}: {fault.message}')
        if time.monotonic() - logged > PROGRESS_INTERVAL:
            logged = now = time.monotonic()
            left = min((now - started) / result.trials * (trials - result.trials), started + campaign.seconds - now)
            log(
                f'{campaign.name}: {result.trials} of {trials} trials, {len(result.faults)} faults, '
                f'about {max(left, 0.0) / 60.0:.1f} min left'
            )
    result.seconds = time.monotonic() - started
    return result


def remove(directory: Path) -> None:
    """Remove the directory of a trial."""
    for path in sorted(directory.rglob('*'), reverse=True):
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink()
    directory.rmdir()
