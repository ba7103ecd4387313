"""Runs on a disk that becomes full at a random moment, each of which must leave a whole run that has failed."""

import contextlib
import functools
import os
import random
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from faults.campaign import WRONG, Campaign, Fault, Trial
from faults.judging import call, false_claims, tracebacks
from faults.measured import Measured, run_measured
from faults.processes import PARAMS
from faults.reference import reference_run
from hdd_servo_ros.recording.run_folder import read_run_yaml
from hdd_servo_ros.tools.recover import main as recover

TICKS = 20_000
"""Of each run, no more than the undisturbed one has; on a disk of this size there is room for some of them only."""
SMALLEST, LARGEST = 20_000, 10_000_000
"""Sizes of the disks [bytes]."""
_KINDS = {
    'mcap': (),
    'mcap with zstd': ('-p', 'compression:=zstd'),
    'mcap in several files': ('-p', 'max_bag_size:=1000000'),
    'sqlite3': ('-p', 'storage:=sqlite3'),
}
_LONGEST = 600.0
"""Time for a run, which takes some seconds [s]."""
_FULL = 'No space left on device'


def trial(folder: Path, choice: random.Random) -> Trial:
    """Run `simulate` or `rig` on a small disk."""
    # Equally often in every decade: a disk that is full from the start is as likely as one that lasts.
    size = round(SMALLEST * (LARGEST / SMALLEST) ** choice.random())
    kind = choice.choice(list(_KINDS))
    command = choice.choice(['simulate', 'simulate', 'rig'])
    if why := cannot_make():
        return Trial(f'left out: {why}')
    module = 'hdd_servo_ros.nodes.rig' if command == 'rig' else 'hdd_servo_ros.simulation.simulate'
    directory = folder / 'disk'
    with small_disk(directory, size) as disk:
        given = ('-p', f'run_dir:={directory / "run"}', '-p', f'duration:={TICKS * 1e-4}', '-p', 'plot:=false')
        arguments = ('--ros-args', '--params-file', PARAMS, *given, '-p', 'progress:=false', *_KINDS[kind])
        alone = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}
        done = run_measured(module, *arguments, environment=alone, most_seconds=_LONGEST, inside=disk.inside)
        outcome, faults = _judged(disk.folder / 'run', folder, done)
    faults = [Fault(fault.kind, f'{command}, {kind}, {size} bytes: {fault.seen}') for fault in faults]
    return Trial(f'{command}: {outcome}', faults)


def _judged(run: Path, folder: Path, done: Measured) -> tuple[str, list[Fault]]:
    faults = tracebacks(done.errors, 'the run')
    errors = [line for line in done.errors.splitlines() if line]
    if done.exit_code == 0:
        if not faults:
            faults += false_claims(_copy(run, folder), 0, reference_run(folder.parent))
        return 'room enough', faults
    if done.exit_code != 1:
        faults.append(Fault(WRONG, f'exit code {done.exit_code}: {errors[-1:]}'))
    if sum(_FULL in line for line in errors) != 1:
        faults.append(Fault(WRONG, f'not one line about the disk: {errors}'))
    if not run.exists():
        return 'rejected before its first tick', faults
    said = read_run_yaml(run)
    if said['status'] != 'failed' or 'No space left' not in said['reason']:
        faults.append(Fault(WRONG, f'run.yaml says {said["status"]}: {said["reason"]}'))
    # A copy, for what reads a run keeps its files open.
    faults += false_claims(_copy(run, folder), 1, reference_run(folder.parent))
    if said['last_tick'] is not None and said['last_tick'] >= 0:
        _, printed, found = call(recover, [str(folder / 'copy'), '--dry-run'])
        faults += found
        if ' is whole: ' not in printed:
            faults.append(Fault(WRONG, f'recover does not call it whole: {printed[-300:]}'))
    return 'failed, and whole as far as it comes', faults


def _copy(run: Path, folder: Path) -> Path:
    return Path(shutil.copytree(run, folder / 'copy'))


class SmallDisk(NamedTuple):
    """A disk that is mounted for some processes alone."""

    folder: Path
    """Its files, for this process."""
    inside: Sequence[str]
    """Command that becomes another one, which finds the disk at its path."""


@contextlib.contextmanager
def small_disk(directory: Path, size: int) -> Iterator[SmallDisk]:
    """
    Give a disk in memory, which only a process of its own has mounted: it goes with that process.

    Parameters
    ----------
    directory
        Where to mount it; an empty folder there is made.
    size
        Of the disk [bytes].

    Raises
    ------
    OSError
        If this user may not have name spaces of mounts.
    """
    directory.mkdir()
    # As root of a name space of users where this user is not root: nothing is mounted for anybody else.
    mapped = [] if os.geteuid() == 0 else ['--map-root-user']
    mount = f'mount -t tmpfs -o size={size} tmpfs "$0" && echo mounted && exec cat'
    command = ['unshare', *mapped, '--mount', 'sh', '-c', mount, str(directory)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as keeper:
        assert keeper.stdin is not None
        assert keeper.stdout is not None
        assert keeper.stderr is not None
        try:
            if keeper.stdout.readline() != 'mounted\n':
                raise OSError(f'a small disk cannot be mounted here: {keeper.stderr.read().strip()}')
            # Files are seen from here too, but sqlite would look for them at the path without /proc.
            user = [] if os.geteuid() == 0 else ['--user', '--preserve-credentials']
            inside = ['nsenter', f'--target={keeper.pid}', *user, '--mount']
            yield SmallDisk(Path(f'/proc/{keeper.pid}/root') / directory.relative_to('/'), inside)
        finally:
            keeper.stdin.close()


@functools.cache
def cannot_make() -> str:
    """Return why no small disk can be made here, an empty text if one can."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            with small_disk(Path(folder) / 'disk', 100_000):
                return ''
        except OSError as error:
            return ' '.join(str(error).split())


CAMPAIGN = Campaign('disk_full', 'Disks that become full', 30, 3, 1800.0, trial)
