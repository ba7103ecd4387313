"""Runs with filters between controller and converter: the compiled loop against the blocks, and live changes."""

from typing import Any

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.bench.dsp import ControllerOutputParameters, DspParameters
from hdd_servo_ros.bench.output_filters import FilterParameters
from hdd_servo_ros.control.open_loop import OpenLoopParameters
from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS
from hdd_servo_ros.parameters import ParameterError, from_mapping
from hdd_servo_ros.simulation.experiment import Experiment

T = 1e-4
TICKS = 1500
NODES = {'pid': 'pid_controller', 'adaptive_nn': 'adaptive_nn_controller'}
FILTERS: dict[str, Any] = {
    'dsp.filters.notch.frequencies': (4500.0, 3500.0),
    'dsp.filters.lead.frequencies': (1500.0,),
    'dsp.filters.low_pass.frequencies': (4000.0,),
}


def experiment(controller, sensor='ldv', **dsp):
    values = {**FILTERS, **{f'dsp.{name}': value for name, value in dsp.items()}}
    sections: dict[str, dict[str, Any]] = {NODES[controller]: values}
    return Experiment(T, controller, sections, sensor=sensor)


@pytest.mark.parametrize('count', [1, 2])
@pytest.mark.parametrize(('controller', 'sensor'), [('pid', 'ldv'), ('pid', 'servo'), ('adaptive_nn', 'ldv')])
def test_the_compiled_loop_equals_the_blocks_to_the_bit(controller, sensor, count):
    dsp = {'updates_per_sample': count, 'computation_delay': 1, 'dac_bits': 14, 'dac_range': 10.0}
    whole, blocks = experiment(controller, sensor, **dsp), experiment(controller, sensor, **dsp)
    blocks._kind = None  # called from Python, block by block
    first, second = whole.run(0, 700), whole.run(700, TICKS - 700)
    expected = blocks.run(0, TICKS)
    for topic in SIGNAL_TOPICS:
        if topic.name in expected:
            found = np.concatenate([first[topic.name], second[topic.name]])
            assert found.tobytes() == expected[topic.name].tobytes(), topic.name


def test_open_loop_command_against_scipy():
    """A multisine through the filters at two updates per sample."""
    values = {**FILTERS, 'dsp.updates_per_sample': 2}
    reference = {'reference_generator': {'waveform': 'chirp', 'amplitude': 0.1, 'end_frequency': 3000.0}}
    run = Experiment(T, 'open_loop', {**reference, 'open_loop_controller': values}).run(0, 1000)
    block = DspParameters(filters=from_mapping(FilterParameters, {k[12:]: v for k, v in FILTERS.items()}))
    filters = Experiment(0.5 * T, Pid(PidParameters(), 0.5 * T), dsp=block).dsp.filters
    expected = signal.sosfilt(filters.sos, np.repeat(run.reference.position, 2))
    np.testing.assert_allclose(run.control.voltage, expected[::2], atol=1e-12)
    np.testing.assert_allclose(run.control_updates.half, expected[1::2], atol=1e-12)


def test_a_controller_object():
    filters = from_mapping(FilterParameters, {name[12:]: value for name, value in FILTERS.items()})
    outside = Experiment(T, Pid(PidParameters(), T), dsp=DspParameters(filters=filters)).run(0, 300)
    assert outside.control.tobytes() == experiment('pid').run(0, 300).control.tobytes()


def test_a_change_during_a_run_makes_no_bump():
    """A constant voltage through filters that are added, changed and removed."""
    reference = {'reference_generator': {'waveform': 'constant', 'offset': 0.1}}
    for count in (1, 2):
        own = {'dsp.updates_per_sample': count}
        loop = Experiment(T, 'open_loop', {**reference, 'open_loop_controller': own})
        voltages = [loop.run(0, 100).control.voltage]
        given: dict[str, Any] = {'notch.frequencies': (3000.0, 4000.0), 'low_pass.frequencies': (2000.0,)}
        changes: tuple[dict[str, Any], ...] = (given, {'notch.frequencies': (2500.0,)}, {})
        for change, values in enumerate(changes, 1):
            filters = from_mapping(FilterParameters, values)
            output = ControllerOutputParameters(dsp=DspParameters(updates_per_sample=count, filters=filters))
            sets = {OpenLoopParameters: OpenLoopParameters(), ControllerOutputParameters: output}
            loop.update('open_loop_controller', sets)
            voltages.append(loop.run(100 * change, 100).control.voltage)
        np.testing.assert_allclose(np.concatenate(voltages), 0.1, atol=1e-12)


def test_an_invalid_frequency_names_the_node():
    name = r'pid_controller\.dsp\.filters\.notch\.frequencies: .*below the Nyquist frequency of the filters, 5000 Hz'
    with pytest.raises(ParameterError, match=name):
        Experiment(T, 'pid', {'pid_controller': {'dsp.filters.notch.frequencies': (6000.0,)}})
