"""The memory of a report does not grow with the run: the same for four times as many ticks."""

import subprocess
import sys

import pytest

MOST_GROWTH = 40.0
"""Of the largest memory [MB] from the short run to the long one, which take 130 MB more as whole arrays."""
TICKS = 20_000, 100_000
# Runs are long from fewer ticks on, and their diagrams have fewer points, so that short ones do.
REPORT = """
import sys
from pathlib import Path
from hdd_servo_ros.recording import recorded_run
from hdd_servo_ros.reporting import long_figures, long_runs, loop_panels, run_panels
from hdd_servo_ros.tools.report import main
if sys.argv[1] == 'in pieces':
    recorded_run.LONG_RUN = long_runs.STRETCH = 4096
    long_figures.BUCKETS = loop_panels.BUCKETS = run_panels.BUCKETS = 100
assert main([*sys.argv[3:], '--output', sys.argv[2]]) == 0
# Not the resource module's figure, which may be that of the process that started this one.
status = dict(line.split(':', 1) for line in Path('/proc/self/status').read_text().splitlines())
print('memory', 1024e-6 * float(status['VmHWM'].split()[0]))
"""


@pytest.mark.new_interpreters
def test_the_memory_of_a_report_does_not_grow(simulated, tmp_path):
    runs = [simulated(tmp_path / str(ticks), '-p', f'duration:={ticks * 1e-4!r}') for ticks in TICKS]

    def memory(how, run):
        command = [sys.executable, '-c', REPORT, how, str(tmp_path / 'out'), str(run)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600.0, check=True)
        return float(done.stdout.rpartition('memory')[2])

    short, long = (memory('in pieces', run) for run in runs)
    assert long - short < MOST_GROWTH
    # The measure itself: read into arrays, the long run does take more.
    assert memory('whole', runs[1]) - short > 2.0 * MOST_GROWTH
