"""A run with a disturbance node is the same bits in separate processes, in `rig`, in `simulate` and replayed."""

from pathlib import Path

import numpy as np

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

HERE = Path(__file__).parent
TICKS = 500
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')


def disturbed(bench):
    """Record a run of separate processes, one of them a disturbance node from outside the package."""
    # First: the others do not wait for it.
    disturbance = bench.start('disturbance', script=HERE / 'disturbance.py')
    disturbance.wait_for('waiting for')
    processes = bench.start_nodes('disturbed', *DURATION)
    for process in [*processes.values(), disturbance]:
        assert process.wait() == 0, process.output
    return bench.directory / 'disturbed'


def test_the_same_bits_however_it_is_run(bench):
    recorded = disturbed(bench)
    run = Run.open(recorded)
    ticks = np.arange(TICKS + 1)
    assert run.disturbance.force.tolist() == (1e-3 * (1 + 37 * ticks % 11)).tolist()
    played = ('-p', f'playback:recorded_run:={recorded}')
    for name in ('rig', 'simulate'):
        bench.run(name, *DURATION, *played, '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
    playback = bench.start('playback', *played)
    playback.wait_for('waiting for')
    nodes = bench.start_nodes('processes', *DURATION)
    for process in [playback, *nodes.values()]:
        assert process.wait() == 0, process.output
    assert first_difference(recorded, bench.directory / 'processes') is None
    for how in ((), ('--without-ros',)):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded), *how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert f'ticks 0 to {TICKS}' in ended.stdout
