"""Runs with 2 or 4 updates of the command per sample: the compiled loop against the blocks, and against hold."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.simulation.in_memory import run_in_memory
from hdd_servo_ros.simulation.run_setup import Simulation

T = 1e-4
TICKS = 1500
NODES = {'pid': 'pid_controller', 'adaptive_nn': 'adaptive_nn_controller'}


def experiment(controller, count, sensor='ldv', **dsp):
    values: dict[str, Any] = {'dsp.updates_per_sample': count, 'dsp.interpolation': 'linear'}
    values |= {f'dsp.{name}': value for name, value in dsp.items()}
    sections: dict[str, dict[str, Any]] = {
        NODES[controller]: values,
        'disturbance_generator': {'force_noise.enabled': True},
    }
    return Experiment(T, controller, sections, sensor=sensor)


@pytest.mark.parametrize('sensor', ['ldv', 'servo'])
@pytest.mark.parametrize('controller', NODES)
@pytest.mark.parametrize('count', [2, 4])
def test_the_compiled_loop_equals_the_blocks_to_the_bit(controller, count, sensor):
    dsp = {'computation_delay': 1, 'dac_bits': 12, 'dac_range': 0.2}
    whole = experiment(controller, count, sensor, **dsp)
    blocks = experiment(controller, count, sensor, **dsp)
    blocks._kind = None  # called from Python, block by block
    first, second = whole.run(0, 700), whole.run(700, TICKS - 700)
    expected = blocks.run(0, TICKS)
    for topic in SIGNAL_TOPICS:
        if topic.name in expected:
            found = np.concatenate([first[topic.name], second[topic.name]])
            assert found.tobytes() == expected[topic.name].tobytes(), topic.name
    updates = expected.control_updates
    assert (updates.half != expected.control.voltage).any()
    assert (updates.three_quarters != updates.half).any() == (count == 4)


def test_a_held_command_gives_the_bits_of_one_update():
    once = Experiment(T, 'pid').run(0, TICKS)
    assert 'control_updates' not in once
    for count in (2, 4):
        often = Experiment(T, 'pid', {'pid_controller': {'dsp.updates_per_sample': count}}).run(0, TICKS)
        for name in ('head', 'ldv', 'control', 'estimates'):
            assert often[name].tobytes() == once[name].tobytes()
        assert (often.control_updates == often.control.voltage[:, None]).all()


def test_a_controller_object():
    dsp = DspParameters(updates_per_sample=4, interpolation='linear')
    values = {'dsp.updates_per_sample': 4, 'dsp.interpolation': 'linear'}
    named = Experiment(T, 'pid', {'pid_controller': values}).run(0, 300)
    outside = Experiment(T, Pid(PidParameters(), T), dsp=dsp).run(0, 300)
    assert named.control_updates.tobytes() == outside.control_updates.tobytes()
    assert named.head.tobytes() == outside.head.tobytes()


def test_a_run_in_memory():
    arguments = ['controller:=pid', 'duration:=0.02', 'dsp.updates_per_sample:=2', 'dsp.interpolation:=linear']
    given = (part for each in arguments for part in ('-p', each))
    found = run_in_memory(Simulation(parse_ros_arguments(['--ros-args', *given])))
    u, later = found.control.voltage, found.control_updates
    np.testing.assert_array_equal(later.quarter, u)
    np.testing.assert_array_equal(later.half, later.three_quarters)
    # The second update is the controller's voltage, the first one is half way to it.
    np.testing.assert_allclose(u[1:], 0.5 * (later.half[:-1] + later.half[1:]), atol=1e-15)


def test_seeks_reject_interpolation():
    values = {'seek_controller': {'dsp.updates_per_sample': 2, 'dsp.interpolation': 'linear'}}
    for method in ('final_state', 'ptos'):
        values['seek_controller']['seek.method'] = method
        with pytest.raises(ParameterError, match=r'dsp\.interpolation.*hold with seek\.method'):
            Experiment(T, 'seek', values)
