"""
Campaign: an hour's recording, with the memory that it and its tools take, and the same bits as by `rig`.

``python -m benchmarks.long_run``; an hour takes 10 GB on the disk, compressed, and its replay as much again.
"""

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path

from benchmarks.graph_runs import PARAMS
from benchmarks.measured import run_measured
from hdd_servo_ros.recording.compare_bags import first_difference

HOUR, RIG = 36_000_000, 1_000_000
"""Ticks of 0.1 ms."""
MOST_MEMORY = 500.0
"""Of any command [MB]."""


@dataclasses.dataclass
class LongRunResult:
    """Largest memory [MB] and time [s] by command, and what was wrong, a line each."""

    ticks: int
    rig_ticks: int
    measured: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    wrong: list[str] = dataclasses.field(default_factory=list)

    def __str__(self):
        lines = [f'{name}: {memory:.0f} MB, {seconds:.0f} s' for name, (memory, seconds) in self.measured.items()]
        return '\n'.join(
            [f'long run: {self.ticks} ticks by simulate, {self.rig_ticks} by rig, {len(self.wrong)} wrong', *lines]
        )


def run_campaign(ticks=HOUR, rig_ticks=RIG, folder=None):
    """Run the campaign in a folder, a temporary one if None; return a :class:`LongRunResult`."""
    result = LongRunResult(ticks, rig_ticks)
    with tempfile.TemporaryDirectory(dir=folder) as made:
        directory = Path(made)
        long = directory / 'long'
        _measure(result, 'simulate with its summary', 'hdd_servo_ros.simulation.simulate', *_arguments(long, ticks))
        _measure(result, 'report', 'hdd_servo_ros.tools.report', long)
        _measure(result, 'recover', 'hdd_servo_ros.tools.recover', long, '--dry-run')
        if rig_ticks:
            rig = directory / 'rig'
            _measure(result, 'rig with its summary', 'hdd_servo_ros.nodes.rig', *_arguments(rig, rig_ticks))
            difference = first_difference(rig, long, rig_ticks)
            if difference is not None:
                result.wrong.append(f'rig and simulate differ: {difference}')
        _measure(result, 'replay', 'hdd_servo_ros.tools.replay', long, '--without-ros')
    return result


def _arguments(run, ticks):
    given = ('-p', f'run_dir:={run}', '-p', f'duration:={ticks * 1e-4}', '-p', 'compression:=zstd')
    return '--ros-args', '--params-file', PARAMS, *given, '-p', 'plot:=true', '-p', 'progress:=false'


def _measure(result, name, module, *arguments):
    done = run_measured(module, *arguments, environment={'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, most_seconds=7200.0)
    result.measured[name] = done.memory, done.seconds
    if done.exit_code:
        result.wrong.append(f'{name}: exit code {done.exit_code}: {done.errors[-500:]}')
    if done.memory > MOST_MEMORY:
        result.wrong.append(f'{name}: {done.memory:.0f} MB, more than {MOST_MEMORY:.0f} MB')


def main():
    parser = argparse.ArgumentParser(prog='long_run', description='Record an hour and read it; exit code 1 if wrong.')
    parser.add_argument('ticks', type=int, nargs='?', default=HOUR, help='of simulate')
    parser.add_argument('rig_ticks', type=int, nargs='?', default=RIG, help='of rig, 0 for none')
    parser.add_argument('--folder', help='where to make a temporary folder; an hour takes 10 GB, its replay as much')
    parsed = parser.parse_args()
    result = run_campaign(parsed.ticks, parsed.rig_ticks, parsed.folder)
    print(result, *result.wrong, sep='\n')
    return bool(result.wrong)


if __name__ == '__main__':
    sys.exit(main())
