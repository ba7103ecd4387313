"""A run with a disturbance node is the same bits in separate processes, in `rig`, in `simulate` and replayed."""

import re
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Vector3Stamped

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

HERE = Path(__file__).parent
EXAMPLE = HERE.parent.parent / 'examples' / 'disturbance_node.py'
TICKS = 500
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')


def disturbed(bench):
    """Record a run of separate processes, one of them a disturbance node from outside the package."""
    processes = bench.start_nodes('disturbed', *DURATION)
    disturbance = bench.start('disturbance', script=EXAMPLE)
    for process in [*processes.values(), disturbance]:
        assert process.wait() == 0, process.output
    return bench.directory / 'disturbed'


def test_the_code_of_the_document_is_the_example():
    document = (HERE.parent.parent / 'docs' / 'howto' / 'custom-disturbance.md').read_text('utf8')
    assert EXAMPLE.read_text('utf8') in re.findall(r'```python\n(.*?)```', document, re.DOTALL)


@pytest.mark.parametrize('joins', ['before', 'during'])
def test_an_ordinary_publisher_is_ignored_with_a_warning(bench, outside, joins):
    """It is not a loop node: the run has no disturbance and logs a warning."""
    duration = ('-p', 'duration:=0.4')
    bench.run('simulate', *duration, '-p', 'run_dir:=simulated')
    publishers = []
    if joins == 'before':
        publishers.append(outside.create_publisher(Vector3Stamped, '/disturbance', 10))
    process = bench.start('rig', *duration, '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    if joins == 'during':
        process.wait_for('real-time factor')
        publishers.append(outside.create_publisher(Vector3Stamped, '/disturbance', 10))
    while process.popen.poll() is None:
        for publisher in publishers:
            publisher.publish(Vector3Stamped())
        outside.spin_for(0.05)
    assert process.wait() == 0, process.output
    lines = [line for line in process.output.splitlines() if 'WARN' in line]
    assert len(lines) == 1, process.output
    assert '/disturbance is ignored: its publisher /outside is not a loop node of this run' in lines[0]
    assert 'examples/disturbance_node.py' in lines[0]
    assert first_difference(bench.directory / 'run', bench.directory / 'simulated') is None


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
