"""The bench's instruments in the graph: the same bits as in `simulate` with every effect on, and visible saturation."""

import re
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.recording.compare_bags import first_difference

PARAMS = Path(__file__).parents[2] / 'params'
EVERY_EFFECT = {
    'deterministic_timer:duration': 0.2,
    'rig:plot': 'false',
    'simulate:plot': 'false',
    'ldv_sensor:noise_measure': 'density',
    'ldv_sensor:noise_bandwidth': 20000.0,
    'ldv_sensor:demodulator_delay': 1.3e-5,
    'ldv_sensor:demodulator_bandwidth': 30000.0,
    'ldv_sensor:dropout_rate': 30.0,
    'ldv_sensor:adc_bits': 14,
    # Below the amplitude of the sine, 0.25 V.
    'ldv_sensor:output_range': 0.24,
    'adaptive_nn_controller:velocity_source': 'difference',
    'pid_controller:velocity_source': 'difference',
    'pid_controller:derivative_bandwidth': 3000.0,
}
ARGUMENTS = [
    '--params-file',
    str(PARAMS / 'one_sample_delay.yaml'),
    *(word for name, value in EVERY_EFFECT.items() for word in ('-p', f'{name}:={value}')),
]


@pytest.mark.parametrize('controller', ['adaptive_nn', 'pid'])
def test_every_effect_in_the_graph_and_in_simulate(bench, controller):
    told = {}
    for executable in ('simulate', 'rig'):
        process = bench.run(
            executable, *ARGUMENTS, '-p', f'controller:={controller}', '-p', f'bag_recorder:run_dir:={executable}'
        )
        told[executable] = set(re.findall(r'the (\w+) output saturates at tick (\d+)', process.output))
        # Each output once, and the same in the summary.
        assert process.output.count('saturates at tick') == len(told[executable]) > 0
        for output, tick in told[executable]:
            assert re.search(rf'saturation .*{output} output \d+ of 2001 samples, first at tick {tick}', process.output)
    assert told['rig'] == told['simulate']
    difference = first_difference(bench.directory / 'simulate', bench.directory / 'rig')
    assert difference is None, difference
    signals = Run.open(bench.directory / 'rig')
    # The delay: nothing at first; the converter: whole steps.
    assert signals.control[0].tolist() == [0.0, 0.0, 0.0]
    steps = signals.control[:, 0] / (10.0 / 2**15)
    np.testing.assert_array_equal(steps, np.round(steps))
    parameters = bench.run_yaml('rig')['nodes'][f'/{controller}_controller']['parameters']
    assert parameters['dsp.computation_delay'] == 1


def test_each_node_in_its_own_process_with_every_effect(bench):
    processes = bench.start_nodes('processes', *ARGUMENTS)
    for process in processes.values():
        assert process.wait() == 0, process.output
    assert 'output saturates at tick' in processes['ldv_sensor'].output
    bench.run('simulate', *ARGUMENTS, '-p', 'bag_recorder:run_dir:=simulated')
    difference = first_difference(bench.directory / 'simulated', bench.directory / 'processes')
    assert difference is None, difference


def test_a_resolution_without_a_range_is_rejected(bench):
    for executable in ('rig', 'simulate', 'pid_controller'):
        process = bench.start(executable, '-p', 'controller:=pid', '-p', 'dsp.dac_bits:=12')
        assert process.wait() == 2
        assert 'dsp.dac_range' in process.output
        assert 'Traceback' not in process.output
