"""Compiled loop against the blocks called one by one: bit-identical, wherever the run is split."""

from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.simulation.closed_loop import Controllers, closed_loop
from hdd_servo_ros.simulation.experiment import Experiment

T = 1e-4
TICKS = 3000
SIGNALS = ('reference', 'head', 'ldv', 'control', 'estimates')


CONTROLLER_NODES = ('adaptive_nn_controller', 'pid_controller', 'open_loop_controller')
EVERY_EFFECT = {
    'ldv_sensor': {
        'noise_measure': 'density',
        'noise_bandwidth': 3000.0,
        'demodulator_delay': 1.7e-5,
        'demodulator_bandwidth': 20000.0,
        'dropout_rate': 50.0,
        'adc_bits': 14,
        'output_range': 0.2,
    },
    **{
        node: {'dsp.computation_delay': 1, 'dsp.dac_bits': 12, 'dsp.dac_range': 0.07, 'control_limit': 1.0}
        for node in CONTROLLER_NODES
    },
    'signal_analyzer': {'dsp.computation_delay': 1, 'dsp.dac_bits': 12, 'dsp.dac_range': 0.07},
}


def experiment(controller, effects=None):
    sections: dict[str, dict[str, Any]] = {
        'reference_generator': {'waveform': 'chirp', 'frequency': 20.0, 'end_frequency': 300.0, 'sweep_time': 0.2},
        'vcm_plant': {'disturbance.amplitude': 0.01, 'disturbance.angular_frequency': 300.0},
        'adaptive_nn_controller': {'compensator.enabled': True, 'width.enabled': True, 'integral_gain': 1e4},
        'signal_analyzer': {'start_frequency': 200.0, 'stop_frequency': 2000.0},
    }
    # Below the drive's own limit, so that what is held is seen to be the limited voltage.
    for node in CONTROLLER_NODES:
        sections[node] = {**sections.get(node, {}), 'control_limit': 0.08}
    for node, values in (effects or {}).items():
        sections[node] = {**sections.get(node, {}), **values}
    if controller == 'open_loop':
        sections['reference_generator']['amplitude'] = 0.1
    return Experiment(T, controller, sections)


def block_by_block(blocks):
    """Tick k: reference; the head where u_{k-1} has brought it; the vibrometer; u_k."""
    rows: dict[str, list[Any]] = {name: [] for name in SIGNALS}
    u = 0.0
    for k in range(TICKS):
        reference = blocks.reference.step(k)
        head = blocks.plant.output() if k == 0 else blocks.plant.step(k, u)
        ldv = blocks.ldv.step(k, head[0], head[1])
        control = blocks.dsp.step(*blocks.controller.step(blocks.scales.inputs(k, *ldv, *reference)))
        u = control[0]
        values = (reference, head, (*ldv, 0.0), control, blocks.controller.estimates.copy())
        for name, row in zip(SIGNALS, values, strict=True):
            rows[name].append(row)
    return {name: np.array(values) for name, values in rows.items()}


@pytest.mark.parametrize('effects', [None, EVERY_EFFECT], ids=['default', 'every effect'])
@pytest.mark.parametrize('controller', Controllers._fields)
def test_equals_the_blocks_to_the_bit(controller, effects):
    blocks, whole = experiment(controller, effects), experiment(controller, effects)
    expected = block_by_block(blocks)
    result = whole.run(0, TICKS)
    assert whole.ldv.state.tolist() == blocks.ldv.state.tolist()
    assert whole.ldv.history.tolist() == blocks.ldv.history.tolist()
    assert whole.dsp.state.tolist() == blocks.dsp.state.tolist()
    for name in SIGNALS:
        assert result[name].tobytes() == expected[name].tobytes(), name
    assert np.abs(result.head[:, 0]).max() > 0.01
    limited = result.control[:, 0] != result.control[:, 1]
    if effects is None and controller == 'signal_analyzer':
        assert not limited.any()  # it has no limit of its own
        return
    if effects is None:
        assert 0 < np.count_nonzero(limited) < TICKS
    # Without the delay's last command.
    assert 0 < whole.dsp.saturated_samples < TICKS


@pytest.mark.parametrize('cuts', [[1], [1, 2, 3], [1000, 1001, 2999]])
def test_may_be_cut_anywhere(cuts):
    whole = experiment('adaptive_nn').run(0, TICKS)
    pieces, cut = [], experiment('adaptive_nn')
    for first, last in zip([0, *cuts], [*cuts, TICKS], strict=True):
        pieces.append(cut.run(first, last - first))
    for name in SIGNALS:
        assert np.concatenate([piece[name] for piece in pieces]).tobytes() == whole[name].tobytes()


def test_runs_twice_alike_and_otherwise_with_another_seed():
    def run(seed):
        return Experiment(T, 'pid', {'ldv_sensor': {'seed': seed}}).run(0, 500)

    assert run(1).control.tobytes() == run(1).control.tobytes()
    assert run(1).control.tobytes() != run(2).control.tobytes()


def test_the_kernel_is_compiled():
    assert hasattr(closed_loop, 'py_func')
