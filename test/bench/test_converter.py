"""The converters: monotonic, within half a step, and with the noise that quantization has."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.bench.converter import beyond_codes, converted, converter_codes

VOLTS = st.floats(-50.0, 50.0)
BITS = st.integers(2, 24)


@given(VOLTS, VOLTS, BITS)
def test_monotonic(a, b, bits):
    codes = converter_codes(bits, 10.0)
    low, high = sorted((a, b))
    assert converted(low, *codes) <= converted(high, *codes)


@given(VOLTS, BITS)
def test_a_code_within_half_a_step_or_the_end(volts, bits):
    step, lowest, highest = converter_codes(bits, 10.0)
    result = converted(volts, step, lowest, highest)
    assert (result / step).is_integer()
    assert -10.0 <= result <= 10.0 - step
    if beyond_codes(volts, step, lowest, highest):
        assert result in (-10.0, 10.0 - step)
        assert abs(volts) > 10.0 - step
    else:
        assert abs(result - volts) <= 0.5 * step * (1.0 + 1e-9)


@given(VOLTS, BITS)
def test_converting_twice_changes_nothing(volts, bits):
    codes = converter_codes(bits, 10.0)
    assert converted(converted(volts, *codes), *codes) == converted(volts, *codes)


@given(VOLTS)
def test_an_ideal_converter(volts):
    codes = converter_codes(0, 10.0)
    assert converted(volts, *codes) == volts
    assert not beyond_codes(volts, *codes)


def test_every_code_is_reached():
    step, lowest, highest = converter_codes(4, 8.0)
    assert (step, lowest, highest) == (1.0, -8.0, 7.0)
    found = {converted(volts, step, lowest, highest) for volts in np.linspace(-9.0, 9.0, 2001)}
    assert sorted(found) == list(range(-8, 8))


def test_quantization_noise():
    """An input that fills many codes evenly gets an error of step/sqrt(12) rms, and no mean."""
    step, lowest, highest = converter_codes(10, 1.0)
    volts = np.random.default_rng(1).uniform(-0.9, 0.9, 40000)
    error = np.array([converted(v, step, lowest, highest) for v in volts]) - volts
    assert error.std() == pytest.approx(step / math.sqrt(12.0), rel=0.02)
    assert abs(error.mean()) < 0.01 * step
