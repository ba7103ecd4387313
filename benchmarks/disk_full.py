"""
Campaign: runs on a disk that becomes full at a random place, each of which must leave a whole run that has failed.

``python -m benchmarks.disk_full [TRIALS]``; it mounts small disks in memory, which only root may.
"""

import argparse
import contextlib
import dataclasses
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.graph_runs import PARAMS
from benchmarks.measured import run_measured
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.run_folder import read_run_yaml

TICKS = 20_000
"""Of each run; on a disk of this size there is room for some of them only."""
SMALLEST, LARGEST = 20_000, 10_000_000
"""Sizes of the disks [bytes]."""


@dataclasses.dataclass
class DiskFullResult:
    """What was found: numbers of runs, of those that began, and what was wrong, a line each."""

    trials: int = 0
    began: int = 0
    finished: int = 0
    wrong: list[str] = dataclasses.field(default_factory=list)

    def __str__(self):
        return (
            f'disk full: {self.trials} runs, {self.began} of them began, {self.finished} had room enough, '
            f'{len(self.wrong)} left something wrong'
        )


@contextlib.contextmanager
def small_disk(size):
    """Mount a disk of a size [bytes] in memory and yield its folder; raises OSError if this user may not."""
    with tempfile.TemporaryDirectory() as folder:
        command = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise OSError(f'no small disk can be mounted: {done.stderr.strip()}')
        try:
            yield Path(folder)
        finally:
            subprocess.run(['umount', folder], check=True)


def run_campaign(trials=30, seed=0, *, with_rig=True):
    """Run the campaign; return a :class:`DiskFullResult`."""
    chosen, result = random.Random(seed), DiskFullResult()
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / 'reference'
        run_measured('hdd_servo_ros.simulation.simulate', *_arguments(reference))
        for trial in range(trials):
            # Equally often in every decade: a disk that is full from the start is as likely as one that lasts.
            size = round(SMALLEST * (LARGEST / SMALLEST) ** chosen.random())
            storage = chosen.choice(['mcap', 'sqlite3'])
            more = chosen.choice([(), ('-p', 'compression:=zstd'), ('-p', 'max_bag_size:=1000000')])
            more = () if storage == 'sqlite3' else more
            is_rig = with_rig and trial % 3 == 2
            with small_disk(size) as disk:
                where = f'trial {trial}: {"rig" if is_rig else "simulate"}, {storage} {" ".join(more)}, {size} bytes'
                found = _trial(disk / 'run', reference, is_rig, ('-p', f'storage:={storage}', *more), result)
                result.wrong += [f'{where}: {fault}' for fault in found]
    return result


def _arguments(run, *more):
    given = ('-p', f'run_dir:={run}', '-p', f'duration:={TICKS * 1e-4}', '-p', 'plot:=false', '-p', 'progress:=false')
    return '--ros-args', '--params-file', PARAMS, *given, *more


def _trial(run, reference, is_rig, more, result):
    module = 'hdd_servo_ros.nodes.rig' if is_rig else 'hdd_servo_ros.simulation.simulate'
    domain = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}
    result.trials += 1
    done = run_measured(module, *_arguments(run, *more), environment=domain, most_seconds=120.0)
    errors = [line for line in done.errors.splitlines() if line]
    if 'Traceback' in done.errors:
        return ['traceback: ' + errors[-1]]
    if done.exit_code == 0:
        result.finished += 1
        return []
    found = [] if done.exit_code == 1 else [f'exit code {done.exit_code}: {errors[-1:]}']
    if sum('No space left on device' in line for line in errors) != 1:
        found.append(f'not one line about the disk: {errors}')
    if not run.exists():
        return found
    result.began += 1
    said = read_run_yaml(run)
    if said['status'] != 'failed' or 'No space left' not in said['reason']:
        found.append(f'run.yaml says {said["status"]}: {said["reason"]}')
    if said['last_tick'] is not None and said['last_tick'] >= 0:
        mended = run_measured('hdd_servo_ros.tools.recover', run)
        if 'is whole' not in mended.output:
            found.append(f'it is not whole: {mended.output}{mended.errors}')
        # A copy, for a comparison keeps files open.
        copy = reference.parent / 'copy'
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(run, copy)
        difference = first_difference(copy, reference, said['last_tick'])
        if difference is not None:
            found.append(f'it differs: {difference}')
    return found


def main():
    parser = argparse.ArgumentParser(prog='disk_full', description='Run on disks that become full.')
    parser.add_argument('trials', type=int, nargs='?', default=30)
    result = run_campaign(parser.parse_args().trials)
    print(result, *result.wrong, sep='\n')
    return bool(result.wrong)


if __name__ == '__main__':
    sys.exit(main())
