"""
Measure the startup: `simulate` of 0.1 s without recording, and `make run` up to its first tick.

``python -m benchmarks.bench_start [--quick]`` prints every round. All starts are warm: kernels and bytecode
exist from an earlier start. Each round also imports Numba alone, which every run needs.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
PARAMS = ROOT / 'params' / 'seagate_7200_10.yaml'
SIMULATE = 'import sys; from hdd_servo_ros.executables import simulate; sys.exit(simulate())'
"""Content of the script that pip creates for the entry point."""


class Start:
    """
    Benchmarks of the startup.

    Parameters
    ----------
    directory
        Directory for runs and bytecode.
    """

    def __init__(self, directory):
        self.directory = Path(directory)
        self.count = 0
        # Bytecode is kept, as by default.
        self.environment = {name: value for name, value in os.environ.items() if name != 'PYTHONDONTWRITEBYTECODE'}
        self.environment |= {
            'ROS_DOMAIN_ID': str(os.getpid() % 100 + 1),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]),
            'PYTHONPYCACHEPREFIX': str(self.directory / 'bytecode'),
        }

    def numba(self):
        """Return the processor time of a process that imports Numba [s]."""
        return self._processor_time('import numba')

    def simulate(self):
        """Return the processor time of `simulate` of 0.1 s without recording [s]."""
        given = ('--ros-args', '--params-file', PARAMS, '-p', 'duration:=0.1', '-p', 'record:=false')
        return self._processor_time(SIMULATE, *given)

    def _processor_time(self, code, *arguments):
        before = children_time()
        command = [sys.executable, '-c', code, *map(str, arguments)]
        subprocess.run(command, cwd=self.directory, env=self.environment, check=True, capture_output=True)
        return children_time() - before

    def make_run(self):
        """Return the wall time from `make run` to the open bag, the last step before tick 0 [s]."""
        self.count += 1
        run = self.directory / f'start{self.count}'
        started = time.perf_counter()
        process = subprocess.Popen(
            ['make', '-s', 'run', f'ARGS=-p bag_recorder:run_dir:={run} -p plot:=false -p duration:=0.01'],
            cwd=ROOT,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        bag = run / 'bag' / 'bag.mcap'
        while not bag.exists():
            if process.poll() is not None and not bag.exists():
                raise RuntimeError('make run failed')
            time.sleep(0.002)
        elapsed = time.perf_counter() - started
        process.wait()
        return elapsed


def children_time():
    """Return the processor time of the child processes that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def start_values(directory, repeats):
    """
    Run all benchmarks alternately, several times, after a warm-up round.

    Returns
    -------
    dict
        Median [s] by benchmark.
    """
    start = Start(directory)
    measures = {'numba': start.numba, 'simulate': start.simulate, 'make run': start.make_run}
    found: dict[str, list[float]] = {name: [] for name in measures}
    for measure in measures.values():
        measure()
    for _ in range(repeats):
        for name, measure in measures.items():
            found[name].append(measure())
            print(f'  {name:16} {found[name][-1]:.2f} s', flush=True)
    return {name: statistics.median(values) for name, values in found.items()}


def start_rows(values):
    """Return table rows: measurement, value, requirement."""
    numba, simulate = values['numba'], values['simulate']
    return [
        (
            'processor time of `simulate` for 0.1 s without recording',
            f'{simulate:.2f} s, {simulate / numba:.1f} times the import of Numba ({numba:.2f} s)',
            'at most 0.8 s, goal 0.5 s',
        ),
        ('warm `make run` up to its first tick', f'{values["make run"]:.2f} s', 'at most 0.9 s'),
    ]


def main():
    """Print the values of every round, and the medians."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.bench_start', description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run one round, as a smoke test')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        for row in start_rows(start_values(directory, 1 if options.quick else 9)):
            print(' | '.join(row))


if __name__ == '__main__':
    main()
