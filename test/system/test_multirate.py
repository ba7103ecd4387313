"""A run with several updates per sample: the same bits in separate processes, in `rig`, in `simulate` and replayed."""

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, nodes_of_run
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.reporting.run_sensitivity import run_sensitivity
from hdd_servo_ros.simulation import Experiment

TICKS = 400
DURATION = ('-p', f'deterministic_timer:duration:={TICKS / 10_000}')


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compile the kernels before processes wait for each other."""
    Experiment(1e-4, 'pid', {'pid_controller': {'dsp.updates_per_sample': 4}}).run(0, 2)


def arguments(node, count):
    values = {
        'updates_per_sample': count,
        'interpolation': 'linear',
        'computation_delay': 1,
        'dac_bits': 14,
        'dac_range': 10.0,
    }
    dsp = [part for name, value in values.items() for part in ('-p', f'{node}:dsp.{name}:={value}')]
    schedule = f"['0.01 {node} dsp.interpolation hold', '0.02 {node} dsp.interpolation linear']"
    return (*DURATION, *dsp, '-p', f'schedule:={schedule}')


@pytest.mark.parametrize(('controller', 'count'), [('pid', 4), ('adaptive_nn', 2)])
def test_the_same_bits_however_it_is_run(bench, controller, count):
    node = CONTROLLERS[controller]
    given = arguments(node, count)
    for process in bench.start_nodes('processes', *given, nodes=nodes_of_run({CONTROLLER: node})).values():
        assert process.wait() == 0, process.output
    recorded = bench.directory / 'processes'
    for name in ('rig', 'simulate'):
        bench.run(name, *given, '-p', f'controller:={controller}', '-p', f'run_dir:={name}')
        assert first_difference(recorded, bench.directory / name) is None
        assert list(bench.run_yaml(name)['topics']) == list(bench.run_yaml('processes')['topics'])
    for how in ((), ('--without-ros',)):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', str(recorded), *how)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert f'ticks 0 to {TICKS}' in ended.stdout
    run = Run.open(recorded)
    updates = run.control_updates
    assert len(updates) == TICKS + 1
    # Held from 10 ms to 20 ms, one tick late.
    held = (np.asarray(updates) == run.control.voltage[:, None]).all(axis=1)
    assert held[101:201].all()
    assert not held[20:101].all()
    assert not held[201:].all()
    assert run_sensitivity(run) is None  # a parameter was changed


def test_the_topic_is_absent_with_one_update(bench):
    bench.run('rig', *DURATION, '-p', 'controller:=pid', '-p', 'run_dir:=once')
    bench.run('rig', *DURATION, '-p', 'controller:=pid', '-p', 'dsp.updates_per_sample:=2', '-p', 'run_dir:=twice')
    assert 'control_updates' not in bench.run_yaml('once')['topics']
    assert 'control_updates' in bench.run_yaml('twice')['topics']
    once, twice = (Run.open(bench.directory / name) for name in ('once', 'twice'))
    assert once.head.tobytes() == twice.head.tobytes()
    assert (twice.control_updates.half == twice.control.voltage).all()
    found, expected = run_sensitivity(twice), run_sensitivity(once)
    assert found == expected


def test_updates_cannot_change_during_a_run(bench):
    schedule = "['0.01 pid_controller dsp.updates_per_sample 2']"
    process = bench.start('simulate', *DURATION, '-p', 'controller:=pid', '-p', f'schedule:={schedule}')
    assert process.wait() == 2, process.output
    assert 'dsp.updates_per_sample' in process.output
