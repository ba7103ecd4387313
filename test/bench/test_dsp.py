"""The DSP's way out: neutral by default, then limit, steps and delay, each alone and together."""

import math
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.parameters import ParameterError

T = 1e-4


def dsp(**parameters):
    return Dsp(DspParameters(**parameters), T)


@given(st.floats(), st.floats(), st.floats())
def test_the_default_passes_every_bit(u, unsaturated, feedback):
    given_bits = np.array([u, unsaturated, feedback])
    assert np.array(dsp().step(u, unsaturated, feedback)).tobytes() == given_bits.tobytes()


def test_a_delay_of_one_sample():
    late = dsp(computation_delay=1)
    commands = np.random.default_rng(1).normal(size=(50, 3))
    held = np.array([late.step(*command) for command in commands.tolist()])
    assert held[0].tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_array_equal(held[1:], commands[:-1])


def test_the_delay_switched_during_a_run():
    """Into the delay the command is held once more; out of it the one under way is left out."""
    block = dsp()
    held = [block.step(1.0, 1.0, 1.0)[0]]
    block.update(DspParameters(computation_delay=1))
    held += [block.step(u, u, u)[0] for u in (2.0, 3.0)]
    block.update(DspParameters())
    held.append(block.step(4.0, 4.0, 4.0)[0])
    assert held == [1.0, 1.0, 2.0, 4.0]


def test_the_converter_limits_and_rounds():
    block = dsp(dac_bits=3, dac_range=4.0)
    assert [block.step(u, u, u) for u in (0.6, -0.6, 9.0, -9.0)] == [
        (1.0, 0.6, 0.6),
        (-1.0, -0.6, -0.6),
        (3.0, 9.0, 9.0),
        (-4.0, -9.0, -9.0),
    ]
    assert block.limit == 3.0
    assert block.saturated_samples == 2


def test_the_drive_limit_applies_too():
    block = Dsp(DspParameters(dac_range=2.0), T, drive_limit=1.5)
    assert [block.step(u, u, u) for u in (1.2, 7.0, -7.0)] == [(1.2, 1.2, 1.2), (1.5, 7.0, 7.0), (-1.5, -7.0, -7.0)]
    assert (block.limit, block.saturated_samples) == (1.5, 2)
    assert Dsp(DspParameters(dac_bits=3, dac_range=4.0), T, drive_limit=1.5).limit == 1.5


def test_a_limit_without_steps():
    block = dsp(dac_range=2.0)
    assert [block.step(u, u, u)[0] for u in (1.2345, 7.0, -7.0)] == [1.2345, 2.0, -2.0]
    assert block.limit == 2.0
    assert block.saturated_samples == 2
    assert dsp().limit == math.inf


def test_commands_limited_by_the_controller_are_counted():
    block = dsp()
    block.step(10.0, 10.0, 1.0)
    block.step(10.0, 12.0, 1.0)
    assert block.saturated_samples == 1


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('delay', [0, 1])
def test_non_finite_values_are_not_hidden(value, delay):
    block = dsp(dac_bits=16, dac_range=10.0, computation_delay=delay)
    held = [block.step(u, u, u)[0] for u in (value, 0.0)]
    assert not math.isfinite(held[delay])


def test_a_resolution_needs_a_range():
    with pytest.raises(ParameterError, match='dac_range'):
        DspParameters(dac_bits=12)
    with pytest.raises(ParameterError, match='dac_bits'):
        DspParameters(dac_bits=1, dac_range=10.0)


def test_compiling_changes_no_bit():
    from hdd_servo_ros.bench.dsp import dsp_step

    compiled, plain = (dsp(dac_bits=12, dac_range=1.0, computation_delay=1) for _ in range(2))
    for u, unsaturated, feedback in np.random.default_rng(3).normal(size=(300, 3)).tolist():
        expected = cast(Any, dsp_step).py_func(*plain.arrays, u, unsaturated, feedback)
        assert compiled.step(u, unsaturated, feedback) == tuple(float(value) for value in expected)
    assert compiled.state.tolist() == plain.state.tolist()
