"""
Run all benchmarks, print the raw values, and write the tables of ``docs/performance.md``.

``python -m benchmarks [--quick] [--no-write]``. Each value is the median of several runs that alternate with those of
its baseline, so that a slow minute of the machine affects both. For campaigns it is the best run.
"""

import argparse
import datetime as dt
import os
import platform
import re
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.bench_bags import TICK_US, bag_rows, bag_values
from benchmarks.bench_campaign import campaign_rows
from benchmarks.bench_plant import call_cost, kernel_cost, nothing
from benchmarks.bench_rig import rig_rows, rig_values
from benchmarks.bench_start import start_rows, start_values
from benchmarks.bench_study import study_values
from benchmarks.graph_runs import ROOT, Bench, alternating
from hdd_servo_ros.drive.plant import PlantParameters, plant_step
from hdd_servo_ros.messages.topics import LOOP_TOPICS

DOCUMENT = ROOT / 'docs' / 'performance.md'


def resident(pid):
    """Return the resident memory of a process and its children [MiB]."""
    total = 0.0
    children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    for one in [pid, *children]:
        found = re.search(r'VmRSS:\s+(\d+)', Path(f'/proc/{one}/status').read_text())
        total += int(found.group(1)) / 1024 if found else 0.0
    return total


def plant_values():
    """Return table rows: time of one tick of the default drive, and of an empty compiled call [ns]."""
    controls = 0.2 * np.random.default_rng(1).normal(size=50_000)
    inside = 1e9 * kernel_cost(PlantParameters(), controls)
    outside = 1e9 * call_cost(plant_step, PlantParameters(), controls.tolist())
    bare = 1e9 * call_cost(nothing, PlantParameters(), controls.tolist())
    print(f'  {inside:.0f} ns in compiled code, {outside:.0f} ns from Python, empty call {bare:.0f} ns', flush=True)
    return [
        ('one tick of the default drive, in compiled code', f'{inside:.0f} ns', 'at most 2000 ns'),
        (
            'one tick of the default drive, called from Python',
            f'{outside:.0f} ns, including {bare:.0f} ns for the call',
            '',
        ),
    ]


def memory_values(bench, seconds):
    """Return the resident memory of rig and recorder at 6 s of the run and at its end [MiB]."""
    run = bench.folder()
    process = bench.popen('hdd_servo_ros.nodes.rig', *bench.ros_arguments(run, seconds * 10_000))
    bag = run / 'bag' / 'bag.mcap'
    samples = []
    while process.poll() is None:
        time.sleep(0.2)
        try:
            # The bag grows with simulated time, so its size is a measure of the progress.
            samples.append((bag.stat().st_size, resident(process.pid)))
        except (OSError, ValueError):
            continue
    process.communicate()
    size = bag.stat().st_size
    # After the last message the process reads the bag for its summary, which does not count.
    during = [(done / size * seconds, memory) for done, memory in samples if done < 0.99 * size]
    at_six = next(memory for done, memory in during if done >= 6.0)
    print(f'  {at_six:.0f} MiB at 6 s, {during[-1][1]:.0f} MiB at {during[-1][0]:.0f} s', flush=True)
    return at_six, during[-1][1]


def machine():
    """Return a description of the machine."""
    text = Path('/proc/cpuinfo').read_text()
    model = re.search(r'model name\s*: (.+)', text)
    return (
        f'{model.group(1).strip() if model else platform.processor()}, {os.cpu_count()} cores, '
        f'Python {platform.python_version()}, numpy {np.__version__}'
    )


def main():
    """Run all benchmarks."""
    parser = argparse.ArgumentParser(prog='make bench', description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run once with short runs, as a smoke test')
    parser.add_argument('--no-write', action='store_true', help='do not write docs/performance.md')
    options = parser.parse_args()
    repeats = 1 if options.quick else 3
    ticks = 1000 if options.quick else 20_000
    with tempfile.TemporaryDirectory() as directory:
        bench = Bench(directory)
        print('one process: rig, rig over DDS, lower bound, default executor', flush=True)
        one = rig_values(bench, repeats, ticks, default=lambda: bench.default(ticks // 10))
        print('one process per node: lockstep, default executors', flush=True)
        many = alternating(
            repeats,
            processes=lambda: bench.processes(ticks // 4),
            default_processes=lambda: bench.default_processes(ticks // 10),
        )
        print('simulate', flush=True)
        bags = bag_values(bench.directory, repeats, ticks * 10)
        print('runs of chapter 5', flush=True)
        study = study_values(bench.directory, repeats, 4 if options.quick else 20)
        print('campaigns', flush=True)
        campaigns = campaign_rows(bench.directory, repeats, quick=options.quick)
        print('drive alone', flush=True)
        plant = plant_values()
        print('memory', flush=True)
        at_six, at_end = memory_values(bench, 12 if options.quick else 60)
        print('start', flush=True)
        starts = start_values(bench.directory, repeats)
    median = statistics.median
    default = median(one['default'])
    processes, default_processes = median(many['processes']), median(many['default_processes'])
    sent = (ticks // 10 + 1) * len(LOOP_TOPICS)
    losses = (
        f'its recorder lost up to {bench.lost_by_default} of {sent} messages' if bench.lost_by_default else 'no losses'
    )
    rows = [
        *rig_rows(one),
        ('same graph with the default rclpy `SingleThreadedExecutor`', f'{default:.3f}', '', 'baseline'),
        (
            'one process per node',
            f'{processes:.3f}',
            'at least 3 times the default executors',
            f'{processes / default_processes:.1f} times the default executors',
        ),
        ('default executors, one process per node', f'{default_processes:.4f}', '', f'baseline; {losses}'),
        (
            '`simulate` without recording, one core',
            f'{TICK_US / bags["loop"][0]:.0f}',
            'at least 100, goal 300',
            '',
        ),
        *bag_rows(bags),
    ]
    lines = [
        f'Measured {dt.date.today():%Y-%m-%d} on {machine()}; medians of {repeats} runs (campaigns: best '
        f'run), {ticks} ticks of 0.1 ms (default executors: {ticks // 10}).',
        '',
        '| measurement | real-time factor | required | comparison |',
        '|---|---|---|---|',
        *(f'| {" | ".join(row)} |' for row in rows),
        '',
        '| measurement | value | required |',
        '|---|---|---|',
        *(f'| {name} | {value} | {required} |' for name, value, required in plant),
        f'| processor time of a run of 10 s in `study chapter5 --without-ros` | {median(study["study"]):.2f} s; with '
        f'one interpreter per run {median(study["processes"]):.2f} s | |',
        *(f'| {name} | {value} | {required} |' for name, value, required in campaigns),
        f'| memory of `rig` and its recorder, 60 s run | {at_six:.0f} MiB at 6 s, {at_end:.0f} MiB at the end: '
        f'ratio {at_end / at_six:.2f} | ratio at most 1.2 |',
        *(f'| {name} | {value} | {required} |' for name, value, required in start_rows(starts)),
    ]
    table = '\n'.join(lines)
    print(table)
    if not options.no_write and not options.quick:
        text = DOCUMENT.read_text()
        DOCUMENT.write_text(
            re.sub(r'(<!-- table -->\n).*(<!-- end -->)', lambda m: f'{m[1]}{table}\n{m[2]}', text, flags=re.S)
        )


if __name__ == '__main__':
    main()
