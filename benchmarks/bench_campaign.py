"""
Measure the cost of a campaign: 100 runs of 1 s, against one process per run; efficiency of two workers; memory.

``python -m benchmarks.bench_campaign [--quick]`` prints the values. Wall times need two idle cores. Each is the best of
several rounds that alternate between the alternatives, because a disturbance only makes a round slower.
"""

import argparse
import os
import re
import subprocess
import tempfile
import threading
import time
from pathlib import Path

from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.case import parameter_file
from hdd_servo_ros.campaign.start import run_arguments, start_run

RUNS = 100
MANY = 10_000
LONGEST = 3.0
"""Longest allowed wall time of the 100 runs [s]."""
SPEC = {
    'files': ['seagate_7200_10.yaml'],
    'set': {'deterministic_timer:duration': 1.0},
    'controllers': ['adaptive_nn'],
    'metrics': 'all',
}


def campaign_of(runs, duration=1.0):
    """Return a campaign with a number of runs."""
    gains = {'vcm_plant:gain': {'linspace': [0.9, 1.1, runs], 'times_base': True}}
    return Campaign({**SPEC, 'set': {'deterministic_timer:duration': duration}, 'vary': [gains]})


def seconds_of(work):
    """Return wall and processor time of some work, including ended child processes [s]."""
    before, started = os.times(), time.perf_counter()
    work()
    wall, after = time.perf_counter() - started, os.times()
    return wall, sum(after[i] - before[i] for i in range(4))


def by_processes(runs, directory):
    """Make runs by `simulate`, one process per run and one run per core at a time, without bags."""
    due, lock = list(range(runs)), threading.Lock()
    file = parameter_file('seagate_7200_10.yaml')

    def work():
        while True:
            with lock:
                if not due:
                    return
                number = due.pop()
            values = {'duration': 1.0, 'controller': 'adaptive_nn', 'ldv_sensor:seed': number, 'record': False}
            arguments = run_arguments([file], values, Path(directory) / str(number))
            with start_run(arguments, without_ros=True, stdout=subprocess.DEVNULL) as run:
                if run.wait() != 0:
                    raise RuntimeError(f'run {number}')

    threads = [threading.Thread(target=work) for _ in range(len(os.sched_getaffinity(0)))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def resident():
    """Return the resident memory of this process and its children [MiB]."""
    total = 0
    children = Path(f'/proc/self/task/{os.getpid()}/children').read_text().split()
    for one in ['self', *children]:
        try:
            found = re.search(r'Rss:\s+(\d+)', Path(f'/proc/{one}/smaps_rollup').read_text())
        except OSError:
            continue
        total += int(found.group(1)) if found else 0
    return total / 1024


def memory_of(runs, directory):
    """Return the resident memory after a tenth of a campaign of short runs, and at its end [MiB]."""
    samples = []
    results = Path(directory) / 'many' / 'results.jsonl'
    ended = threading.Event()

    def sample():
        while not ended.wait(0.5):
            if results.exists():
                with results.open('rb') as file:
                    samples.append((sum(1 for _ in file), resident()))

    watcher = threading.Thread(target=sample)
    watcher.start()
    try:
        campaign_of(runs, 0.02).run(Path(directory) / 'many', workers=2)
    finally:
        ended.set()
        watcher.join()
    early = next(memory for done, memory in samples if done >= runs // 10)
    late = [memory for done, memory in samples if done < runs][-1]
    return early, late


def campaign_values(directory, repeats, runs=RUNS, many=MANY):
    """Return wall times [s] of all rounds by name, processor time per run [s], and memory [MiB]."""
    campaign = campaign_of(runs)
    # Compiles and imports, so that the startup does not count.
    campaign_of(2).run(workers=1)
    found: dict[str, list[float]] = {'campaign': [], 'one worker': [], 'processor': [], 'processes': []}
    for _ in range(repeats):
        wall, processor = seconds_of(lambda: campaign.run(workers=2))
        found['campaign'].append(wall)
        found['processor'].append(processor / runs)
        found['one worker'].append(seconds_of(lambda: campaign.run(workers=1))[0])
        found['processes'].append(seconds_of(lambda: by_processes(runs, directory))[0])
        print('  ' + ', '.join(f'{name} {values[-1]:.3g} s' for name, values in found.items()), flush=True)
    memory = memory_of(many, directory)
    print(f'  memory {memory[0]:.0f} MiB after a tenth of {many} runs, {memory[1]:.0f} MiB at the end', flush=True)
    return found, memory


def campaign_rows(directory, repeats, *, quick):
    """Return rows of the second table of ``docs/performance.md``."""
    runs, many = (10, 200) if quick else (RUNS, MANY)
    found, memory = campaign_values(directory, repeats, runs, many)
    wall, one, processor, processes = (
        min(found[name]) for name in ('campaign', 'one worker', 'processor', 'processes')
    )
    return [
        (
            f'`campaign`, {runs} runs of 1 s with all metrics, 2 workers, best of {repeats}',
            f'{wall:.2f} s, {1e3 * processor:.0f} ms processor time per run; one process per run {processes:.1f} s, '
            f'{processes / wall:.0f} times as long',
            f'at most {LONGEST * runs / RUNS:.2g} s',
        ),
        (
            f'the same campaign with 1 worker, best of {repeats}; efficiency of 2 workers',
            f'{one:.2f} s; {one / (2.0 * wall):.2f}',
            'efficiency at least 0.9',
        ),
        (
            f'memory of a campaign of {many} runs, with 2 workers',
            f'{memory[0]:.0f} MiB after a tenth of them, {memory[1]:.0f} MiB at the end: '
            f'ratio {memory[1] / memory[0]:.2f}',
            'no growth',
        ),
    ]


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run one round of a few runs, as a smoke test')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        for row in campaign_rows(directory, 1 if options.quick else 3, quick=options.quick):
            print(' | '.join(row))


if __name__ == '__main__':
    main()
