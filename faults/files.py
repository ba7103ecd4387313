"""Files that are damaged: bags, their metadata, `run.yaml` and parameter files."""

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
_TOPICS = ('reference', 'head', 'ldv', 'control', 'estimates')


@functools.cache
def originals() -> dict[str, Path]:
    """Return whole runs, one a kind of storage."""
    folder = Path(tempfile.mkdtemp(prefix='hdd_servo_ros-faults-'))
    kinds = {'mcap': (), 'zstd': ('-p', 'compression:=zstd'), 'sqlite3': ('-p', 'storage:=sqlite3')}
    return {name: simulated(folder / name, '-p', 'duration:=0.02', *given) for name, given in kinds.items()}


def trial(folder: Path, choice: random.Random) -> Trial:
    """Damage one file, and let the commands read it."""
    if choice.random() < 0.25:
        return _parameter_file(folder, choice)
    storage, original = choice.choice(list(originals().items()))
    damaged = folder / 'run'
    shutil.copytree(original, damaged)
    path = choice.choice([damaged / 'run.yaml', damaged / 'bag' / 'metadata.yaml', *_bags(damaged)])
    how = damage(path, choice)
    what = f'{storage if path in _bags(damaged) else path.name}, {how}'
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
        if code == 0:
            accepted.append(command.__module__.rpartition('.')[2])
        elif not found and not printed.strip():
            faults.append(Fault(WRONG, f'{command.__module__} ends with {code} and says nothing'))
    if 'compare_bags' in accepted and not _is_same(original, damaged):
        faults.append(Fault(WRONG, f'{what}: compare_bags says that it is the same'))
    if 'recover' in accepted and path in _bags(damaged) and not _is_same(original, damaged):
        faults.append(Fault(WRONG, f'{what}: recover says that it is whole'))
    return Trial(f'{path.suffix[1:]}: {"all read it" if len(accepted) == 3 else "refused or told"}', faults)


def _bags(run: Path) -> list[Path]:
    return sorted(path for path in (run / 'bag').iterdir() if path.suffix in ('.mcap', '.db3'))


def _is_same(original: Path, damaged: Path) -> bool:
    """Return whether the numbers of two runs are the same, or those of the damaged one refused."""
    try:
        left, right = Run.open(original), Run.open(damaged)
        return all(np.asarray(left[topic]).tobytes() == np.asarray(right[topic]).tobytes() for topic in _TOPICS)
    except (OSError, BagError, LookupError, ValueError):
        return True


def _parameter_file(folder: Path, choice: random.Random) -> Trial:
    path = folder / 'damaged.yaml'
    shutil.copy(PARAMS, path)
    how = damage(path, choice)
    given = ['--ros-args', '--params-file', str(path), '-p', 'duration:=0.001', '-p', 'record:=false']
    code, printed, faults = call(simulate, given)
    if code not in (0, 1, 2) and not faults:
        faults = [Fault(WRONG, f'exit code {code}')]
    if code and not printed.strip():
        faults = [*faults, Fault(WRONG, f'{how}: ends with {code} and says nothing')]
    return Trial(f'parameter file: exit code {code}', faults)


def damage(path: Path, choice: random.Random) -> str:
    """Change a file; return how."""
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


CAMPAIGN = Campaign('files', 'Damaged bags, metadata, run.yaml and parameter files', 2000, 18, 2400.0, trial)
