"""A run with a disturbance node is the same bits in separate processes, in `rig`, in `simulate` and replayed."""

from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

HERE = Path(__file__).parent
TICKS = 500
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')


def disturbed(bench):
    """Record a run of separate processes, one of them a disturbance node from outside the package."""
    processes = bench.start_nodes('disturbed', *DURATION)
    disturbance = bench.start('disturbance', script=HERE / 'disturbance.py')
    for process in [*processes.values(), disturbance]:
        assert process.wait() == 0, process.output
    return bench.directory / 'disturbed'


# Copies start so fast that a disturbance may come before its readers, or after the run has begun.
@pytest.mark.new_interpreters
def test_the_same_bits_however_it_is_run(bench):
    recorded = disturbed(bench)
    run = Run.open(recorded)
    ticks = np.arange(TICKS + 1)
    assert run.disturbance.force.tolist() == (1e-3 * (1 + 37 * ticks % 11)).tolist()
    played = ('-p', f'playback:recorded_run:={recorded}')
    for name in ('rig', 'simulate'):
        bench.run(name, *DURATION, *played, '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
    nodes = bench.start_nodes('processes', *DURATION)
    nodes['playback'] = bench.start('playback', *played)
    for process in nodes.values():
        assert process.wait() == 0, process.output
    assert first_difference(recorded, bench.directory / 'processes') is None
    for how in ((), ('--without-ros',)):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded), *how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert f'ticks 0 to {TICKS}' in ended.stdout
