"""Updates of the command within a sample: interpolation, and limit, rounding and delay of each update."""

import math
from typing import Any, cast

import numpy as np
import pytest

from hdd_servo_ros.bench.dsp import Dsp, DspParameters, dsp_step
from hdd_servo_ros.parameters import ParameterError

T = 1e-4
COMMANDS = np.random.default_rng(1).normal(size=200).tolist()


def staircase(block, commands):
    """Return the voltages of all updates, one row per sample."""
    return np.array([block.voltages(block.step(u, u, u)[0]) for u in commands])


def dsp(count, interpolation='linear', **parameters):
    return Dsp(DspParameters(updates_per_sample=count, interpolation=interpolation, **parameters), T)


@pytest.mark.parametrize('count', [1, 2, 4])
def test_hold_repeats_the_command_of_one_update(count):
    found = staircase(dsp(count, 'hold', dac_bits=12, dac_range=2.0, computation_delay=1), COMMANDS)
    once = staircase(dsp(1, 'hold', dac_bits=12, dac_range=2.0, computation_delay=1), COMMANDS)
    np.testing.assert_array_equal(found, np.repeat(once, count, axis=1))


@pytest.mark.parametrize('count', [2, 4])
@pytest.mark.parametrize('delay', [0, 1])
def test_linear_interpolation_against_numpy(count, delay):
    found = staircase(dsp(count, computation_delay=delay), COMMANDS).ravel()
    samples = np.arange(len(COMMANDS) + 1)
    fine = np.arange(1, count * len(COMMANDS) + 1) / count
    expected = np.interp(fine, samples, [0.0, *COMMANDS])
    if delay:
        expected = np.concatenate([np.zeros(count), expected[:-count]])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-15)


def test_one_update_is_not_interpolated():
    assert staircase(dsp(1), COMMANDS)[:, 0].tolist() == COMMANDS


@pytest.mark.parametrize('delay', [0, 1])
def test_limit_and_rounding_of_each_update(delay):
    converter: dict[str, Any] = {'dac_bits': 4, 'dac_range': 1.0}
    found = staircase(dsp(4, computation_delay=delay, **converter), COMMANDS)
    plain = staircase(dsp(4, computation_delay=delay), COMMANDS)
    step = 0.125
    expected = np.clip(np.floor(plain / step + 0.5), -8, 7) * step
    np.testing.assert_array_equal(found, expected)


def test_a_sample_with_a_limited_update_counts_once():
    block = dsp(4, dac_range=1.0)
    voltages = staircase(block, [0.8, 2.0, 0.4, 0.2])
    # From 2 V down to 0.4 V, the first two updates of the third sample are above the range.
    assert voltages[2].tolist() == [1.0, 1.0, pytest.approx(0.8), pytest.approx(0.4)]
    assert block.saturated_samples == 2


def test_the_voltage_before_the_limit_keeps_what_the_controller_cut_off():
    block = dsp(2)
    assert block.step(1.0, 3.0, 0.7) == (0.5, 2.5, 0.7)
    assert block.saturated_samples == 1


def test_the_mean_is_that_of_the_staircase():
    block = dsp(4, computation_delay=1)
    for u in COMMANDS:
        first, _, _ = block.step(u, u, u)
        assert block.mean_voltage(first) == pytest.approx(np.mean(block.voltages(first)), abs=1e-15)
    assert dsp(1).mean_voltage(0.3) == 0.3


def test_interpolation_changed_during_a_run():
    block = dsp(2)
    block.step(1.0, 1.0, 1.0)
    block.update(DspParameters(updates_per_sample=2))
    assert block.voltages(block.step(2.0, 2.0, 2.0)[0]) == (2.0, 2.0)
    block.update(DspParameters(updates_per_sample=2, interpolation='linear'))
    assert block.voltages(block.step(4.0, 4.0, 4.0)[0]) == (3.0, 4.0)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_non_finite_values_are_not_hidden(value):
    block = dsp(4, dac_bits=16, dac_range=10.0)
    assert not any(map(math.isfinite, block.voltages(block.step(value, value, value)[0])))


def test_other_numbers_of_updates_are_rejected():
    for count in (0, 3, 5):
        with pytest.raises(ParameterError, match='updates_per_sample'):
            DspParameters(updates_per_sample=count)
    with pytest.raises(ParameterError, match='interpolation'):
        DspParameters(interpolation='cubic')


def test_compiling_changes_no_bit():
    compiled, plain = (dsp(4, dac_bits=12, dac_range=1.0, computation_delay=1) for _ in range(2))
    for u in COMMANDS:
        expected = cast(Any, dsp_step).py_func(*plain.arrays, u, u, 0.5 * u)
        assert compiled.step(u, u, 0.5 * u) == tuple(float(value) for value in expected)
        assert compiled.later_voltages == plain.later_voltages
