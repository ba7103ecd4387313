"""
Measure the cost of a run of chapter 5 in ``study --without-ros``, against one interpreter per run.

``python -m benchmarks.bench_study [--quick]`` prints the processor time per run of every round [s], including startup.
"""

import argparse
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from hdd_servo_ros.campaign.runner import run_cases
from hdd_servo_ros.campaign.start import start_run
from hdd_servo_ros.studies.chapter import figures
from hdd_servo_ros.studies.chapter5.cases import DURATION

RUNS = 20
"""Number of runs, of the 80 of the study; each lasts 10 s."""


def study_cases(count):
    """Return a number of cases of chapter 5, all of the usual duration."""
    cases = {case.name: case for figure in figures('chapter5').values() for case in figure.CASES}
    usual = [case for case in cases.values() if case.overrides.get('deterministic_timer:duration') == DURATION]
    return usual[:count]


def by_study(cases, directory):
    """Return the processor time per run in the worker processes of the study [s]."""
    return _per_run(cases, directory, lambda: run_cases(cases, directory, without_ros=True, report=lambda line: None))


def by_processes(cases, directory):
    """Return the processor time per run with one interpreter per run [s]."""

    def work():
        for case in cases:
            with start_run(
                case.arguments({}, directory / case.name), without_ros=True, stdout=subprocess.DEVNULL
            ) as run:
                if run.wait() != 0:
                    raise RuntimeError(case.name)

    return _per_run(cases, directory, work)


def _per_run(cases, directory, work):
    before = os.times()
    work()
    after = os.times()
    shutil.rmtree(directory)
    return sum(after[i] - before[i] for i in range(4)) / len(cases)


def study_values(directory, repeats, runs=RUNS):
    """Return the processor time per run of every round [s] by benchmark."""
    cases = study_cases(runs)
    found: dict[str, list[float]] = {'study': [], 'processes': []}
    for _ in range(repeats):
        for name, measure in (('study', by_study), ('processes', by_processes)):
            found[name].append(measure(cases, Path(directory) / name))
            print(f'  {name:16} {found[name][-1]:.3g} s', flush=True)
    return found


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run one round of a few runs, as a smoke test')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        study_values(directory, 1 if options.quick else 3, 4 if options.quick else RUNS)


if __name__ == '__main__':
    main()
