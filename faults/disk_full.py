"""Runs on a disk that becomes full at a random moment; each must leave an intact run with the status failed."""

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
"""Ticks of a run, at most those of the undisturbed one; only some of the disks are large enough."""
SMALLEST, LARGEST = 20_000, 10_000_000
"""Sizes of the disks [bytes]."""
_KINDS = {
    'mcap': (),
    'mcap with zstd': ('-p', 'compression:=zstd'),
    'mcap in several files': ('-p', 'max_bag_size:=1000000'),
    'sqlite3': ('-p', 'storage:=sqlite3'),
}
_LONGEST = 600.0
"""Time limit of a run, which takes a few seconds [s]."""
_FULL = 'No space left on device'


def trial(folder: Path, choice: random.Random) -> Trial:
    """Run `simulate` or `rig` on a small disk."""
    # Log-uniform, so that disks that are full from the start are as likely as large ones.
    size = round(SMALLEST * (LARGEST / SMALLEST) ** choice.random())
    kind = choice.choice(list(_KINDS))
    command = choice.choice(['simulate', 'simulate', 'rig'])
    if why := cannot_make():
        return Trial(f'skipped: {why}')
    module = 'hdd_servo_ros.nodes.rig' if command == 'rig' else 'hdd_servo_ros.simulation.simulate'
    directory = folder / 'disk'
    with small_disk(directory, size) as disk:
        given = ('-p', f'run_dir:={directory / "run"}', '-p', f'duration:={TICKS * 1e-4}', '-p', 'plot:=false')
        arguments = ('--ros-args', '--params-file', PARAMS, *given, '-p', 'progress:=false', *_KINDS[kind])
        alone = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}
        done = run_measured(module, *arguments, environment=alone, most_seconds=_LONGEST, inside=disk.inside)
        outcome, faults = _judged(disk.folder / 'run', folder, done)
    faults = [Fault(fault.kind, f'{command}, {kind}, {size} bytes: {fault.message}') for fault in faults]
    return Trial(f'{command}: {outcome}', faults)


def _judged(run: Path, folder: Path, done: Measured) -> tuple[str, list[Fault]]:
    faults = tracebacks(done.errors, 'the run')
    errors = [line for line in done.errors.splitlines() if line]
    if done.exit_code == 0:
        if not faults:
            faults += false_claims(_copy(run, folder), 0, reference_run(folder.parent))
        return 'enough space', faults
    if done.exit_code != 1:
        faults.append(Fault(WRONG, f'exit code {done.exit_code}: {errors[-1:]}'))
    if sum(_FULL in line for line in errors) != 1:
        faults.append(Fault(WRONG, f'expected one line about the disk: {errors}'))
    if not run.exists():
        return 'rejected before its first tick', faults
    content = read_run_yaml(run)
    if content['status'] != 'failed' or 'No space left' not in content['reason']:
        faults.append(Fault(WRONG, f'run.yaml records {content["status"]}: {content["reason"]}'))
    # A copy, because an opened run keeps its files open.
    faults += false_claims(_copy(run, folder), 1, reference_run(folder.parent))
    if content['last_tick'] is not None and content['last_tick'] >= 0:
        _, printed, found = call(recover, [str(folder / 'copy'), '--dry-run'])
        faults += found
        if ' is intact: ' not in printed:
            faults.append(Fault(WRONG, f'recover does not report it as intact: {printed[-300:]}'))
    return 'failed, intact up to its last tick', faults


def _copy(run: Path, folder: Path) -> Path:
    return Path(shutil.copytree(run, folder / 'copy'))


class SmallDisk(NamedTuple):
    """A disk that is mounted only for some processes."""

    folder: Path
    """Path of its files for this process."""
    inside: Sequence[str]
    """Command prefix for processes that find the disk at its path."""


@contextlib.contextmanager
def small_disk(directory: Path, size: int) -> Iterator[SmallDisk]:
    """
    Create a disk in memory, mounted only for a separate process; the disk is removed with that process.

    Parameters
    ----------
    directory
        Mount point, which is created.
    size
        Size of the disk [bytes].

    Raises
    ------
    OSError
        If the user may not create mount namespaces.
    """
    directory.mkdir()
    # A user other than root becomes root of a user namespace. Nothing is mounted for other processes.
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
                raise OSError(f'cannot mount a small disk: {keeper.stderr.read().strip()}')
            # Files are visible here too, but sqlite would look for them at the path without /proc.
            user = [] if os.geteuid() == 0 else ['--user', '--preserve-credentials']
            inside = ['nsenter', f'--target={keeper.pid}', *user, '--mount']
            yield SmallDisk(Path(f'/proc/{keeper.pid}/root') / directory.relative_to('/'), inside)
        finally:
            keeper.stdin.close()


@functools.cache
def cannot_make() -> str:
    """Return the reason if no small disk can be created, otherwise an empty string."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            with small_disk(Path(folder) / 'disk', 100_000):
                return ''
        except OSError as error:
            return ' '.join(str(error).split())


CAMPAIGN = Campaign('disk_full', 'Full disks', 30, 3, 1800.0, trial)
