"""Damaged files: bags, their metadata, `run.yaml` and parameter files."""

import functools
import random
import shutil
import tempfile
from pathlib import Path

import numpy as np

from faults.campaign import WRONG, Campaign, Fault, Trial
from faults.judging import call
from faults.processes import PARAMS
from faults.reference import simulated
from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.simulation.simulate import main as simulate
from hdd_servo_ros.tools.recover import main as recover
from hdd_servo_ros.tools.report import main as report

_TEXTS = (
    '',
    '{',
    '[',
    '- ',
    ': ',
    '&a',
    '*a',
    '!!python/object:os.system',
    '\t',
    '\0',
    '1e999',
    '0b_',
    '2020-01-01',
    '~',
)
_ACCEPTED = 'read by all commands'
_TOPICS = ('reference', 'head', 'ldv', 'control', 'estimates')


@functools.cache
def originals(where: Path) -> dict[str, Path]:
    """Return intact runs in a new directory below ``where``, one per kind of storage; recorded once."""
    folder = Path(tempfile.mkdtemp(prefix='originals-', dir=where))
    kinds = {
        'mcap': (),
        'zstd': ('-p', 'compression:=zstd'),
        'split': ('-p', 'max_bag_duration:=0.005'),
        'sqlite3': ('-p', 'storage:=sqlite3'),
    }
    return {name: simulated(folder / name, '-p', 'duration:=0.02', *given) for name, given in kinds.items()}


def trial(folder: Path, choice: random.Random) -> Trial:
    """Damage one file, and read it with the commands."""
    if choice.random() < 0.25:
        return _parameter_file(folder, choice)
    storage, original = choice.choice(list(originals(folder.parent).items()))
    damaged = folder / 'run'
    shutil.copytree(original, damaged)
    is_of_bag = choice.random() < 0.5
    path = choice.choice(_bags(damaged) if is_of_bag else [damaged / 'run.yaml', damaged / 'bag' / 'metadata.yaml'])
    how = damage(path, choice)
    what = f'{storage if is_of_bag else path.name}, {how}'
    if path.exists() and path.read_bytes() == (original / path.relative_to(damaged)).read_bytes():
        return Trial('unchanged')
    faults = []
    accepted = []
    for command, arguments in (
        (report, [str(damaged), '--output', str(folder / 'report')]),
        (compare_bags, [str(original), str(damaged)]),
        (recover, ['--dry-run', str(damaged)]),
    ):
        code, printed, found = call(command, arguments)
        faults += found
        # A dry run that finds damage also ends with 0.
        if code == 0 and (command is not recover or ' is intact: ' in printed):
            accepted.append(command.__module__.rpartition('.')[2])
        elif not found and not printed.strip():
            faults.append(Fault(WRONG, f'{command.__module__} ends with {code} and prints nothing'))
        if code not in (0, 1, 3) and not found:
            faults.append(Fault(WRONG, f'{command.__module__} ends with {code}: {printed[-200:]}'))
    outcome = _ACCEPTED if len(accepted) == 3 else 'rejected or reported'
    is_same = _is_same(original, damaged)
    if is_same is False:
        faults.append(Fault(WRONG, 'the run opens with other values'))
    if is_same is None and is_of_bag:
        faults += [Fault(WRONG, f'{name} accepts a run that does not open') for name in accepted]
    if is_of_bag:
        outcome = _ACCEPTED if len(accepted) == 3 else _recovered(original, damaged, faults)
    faults = [Fault(fault.kind, f'{what}: {fault.message}') for fault in faults]
    return Trial(f'{path.suffix[1:]}: {outcome}', faults)


def _recovered(original: Path, damaged: Path, faults: list[Fault]) -> str:
    """Recover a run; return the outcome."""
    output = damaged.parent / 'recovered'
    code, printed, found = call(recover, [str(damaged), '--output', str(output)])
    faults += found
    if code != 0:
        return 'rejected, nothing recoverable'
    if not (output / 'run.yaml').exists():
        faults.append(Fault(WRONG, f'recover writes nothing and ends with 0: {printed[-200:]}'))
    elif _is_same(original, output, is_part=True) is not True:
        faults.append(Fault(WRONG, f'the recovered run has other values, or does not open: {printed[-200:]}'))
    return 'rejected, recovered'


def _bags(run: Path) -> list[Path]:
    return sorted(path for path in (run / 'bag').iterdir() if path.suffix in ('.mcap', '.db3'))


def _is_same(original: Path, other: Path, *, is_part: bool = False) -> bool | None:
    """Return whether two runs have equal values (``is_part``: until the other ends); None if one does not open."""
    try:
        left, right = Run.open(original), Run.open(other)
        pairs = [(np.asarray(left[topic]), np.asarray(right[topic])) for topic in _TOPICS]
    except (OSError, BagError, LookupError, ValueError):
        return None
    if is_part:
        pairs = [(all_rows[: len(part)], part) for all_rows, part in pairs]
    return all(one.tobytes() == two.tobytes() for one, two in pairs)


def _parameter_file(folder: Path, choice: random.Random) -> Trial:
    path = folder / 'damaged.yaml'
    shutil.copy(PARAMS, path)
    how = damage(path, choice)
    given = ['--ros-args', '--params-file', str(path), '-p', 'duration:=0.001', '-p', 'record:=false']
    code, printed, faults = call(simulate, given)
    if code not in (0, 1, 2) and not faults:
        faults = [Fault(WRONG, f'exit code {code}')]
    if code and not printed.strip():
        faults = [*faults, Fault(WRONG, f'{how}: ends with {code} and prints nothing')]
    return Trial(f'parameter file: exit code {code}', faults)


def damage(path: Path, choice: random.Random) -> str:
    """Damage a file; return the kind of damage."""
    content = bytearray(path.read_bytes())
    how = choice.choice(['bits', 'bytes', 'cut', 'hole', 'text', 'empty', 'missing', 'doubled'])
    at = choice.randrange(len(content))
    if how == 'bits':
        for _ in range(choice.randint(1, 4)):
            content[choice.randrange(len(content))] ^= 1 << choice.randrange(8)
    elif how == 'bytes':
        content[at : at + 8] = choice.randbytes(8)
    elif how == 'cut':
        del content[at:]
    elif how == 'hole':
        content[at : at + 512] = bytes(512)
    elif how == 'text':
        content[at:at] = choice.choice(_TEXTS).encode() * choice.choice([1, 1, 3000])
    elif how == 'doubled':
        content += bytes(content)
    path.write_bytes(b'' if how == 'empty' else content)
    if how == 'missing':
        path.unlink()
    return how


CAMPAIGN = Campaign('files', 'Damaged bags, metadata, run.yaml and parameter files', 2000, 18, 3600.0, trial)
