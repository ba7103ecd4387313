"""
What a run of chapter 5 costs in ``study --without-ros``, beside the same run in an interpreter of its own.

``python -m benchmarks.bench_study [--quick]`` prints the processor time per run of every round [s], starts included.
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
"""Of the study's 80, all of 10 s."""


def study_cases(count):
    """Return so many of chapter 5's cases, all of the usual duration."""
    cases = {case.name: case for figure in figures('chapter5').values() for case in figure.CASES}
    usual = [case for case in cases.values() if case.overrides.get('deterministic_timer:duration') == DURATION]
    return usual[:count]


def by_study(cases, directory):
    """Return the processor time per run as the study makes them [s]."""
    return _per_run(cases, directory, lambda: run_cases(cases, directory, without_ros=True, report=lambda line: None))


def by_processes(cases, directory):
    """Return the same with an interpreter for each [s]."""

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


def study_figures(directory, repeats, runs=RUNS):
    """Return the processor time per run of every round [s], by name."""
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
    parser.add_argument('--quick', action='store_true', help='one round of a few runs, to see that it works')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        study_figures(directory, 1 if options.quick else 3, 4 if options.quick else RUNS)


if __name__ == '__main__':
    main()
