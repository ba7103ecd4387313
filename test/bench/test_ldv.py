"""Vibrometer: scales, noise, range and ADC, each against its data sheet value."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.bench.ldv import Ldv, LdvParameters

T = 1e-4
IDEAL = {'noise': False, 'adc_bits': 0, 'output_range': 0.0}
LSB = 10.0 / 2**15


def ldv(**parameters):
    return Ldv(LdvParameters(**parameters), T)


def test_scales_of_chapter_5():
    assert ldv(**IDEAL).step(0, 4.0, 2500.0) == (0.5, 0.5)


def test_noise_has_its_rms_on_both_outputs():
    sensor = ldv(adc_bits=0)
    volts = np.array([sensor.step(k, 0.0, 0.0) for k in range(20000)])
    # The standard deviation of an rms from 20000 deviates is 0.5 %.
    np.testing.assert_allclose(volts.std(axis=0) * [8.0, 5000.0], [3e-3, 3.0], rtol=0.02)
    assert np.all(np.abs(volts.mean(axis=0) * [8.0, 5000.0]) < [1e-4, 0.1])
    assert abs(np.corrcoef(volts.T)[0, 1]) < 0.03


def test_noise_depends_on_seed_and_tick_alone():
    a, b, other = ldv(seed=3), ldv(seed=3), ldv(seed=4)
    forwards = [a.step(k, 1.0, 2.0) for k in range(50)]
    backwards = [b.step(k, 1.0, 2.0) for k in reversed(range(50))]
    assert forwards == backwards[::-1]
    assert [other.step(k, 1.0, 2.0) for k in range(50)] != forwards


def test_noise_off_is_off():
    sensor = ldv(noise=False)
    assert len({sensor.step(k, 1.0, 2.0) for k in range(20)}) == 1


@given(st.floats(-79.0, 79.0))
def test_the_converter_rounds_to_its_step(position):
    volts, _ = ldv(noise=False).step(0, position, 0.0)
    assert (volts / LSB).is_integer()
    assert abs(volts - position / 8.0) <= 0.5 * LSB * (1.0 + 1e-9)


def test_the_converter_has_two_to_the_bits_codes():
    sensor = ldv(noise=False, adc_bits=3, adc_range=4.0)
    codes = {sensor.step(0, 8.0 * volts, 0.0)[0] for volts in np.linspace(-6.0, 6.0, 1201)}
    assert sorted(codes) == [-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]


def test_outputs_saturate_and_are_counted():
    sensor = ldv(noise=False, adc_bits=0)
    assert sensor.step(0, 100.0, -60000.0) == (10.0, -10.0)
    assert sensor.step(1, -100.0, 0.0) == (-10.0, 0.0)
    assert sensor.saturated_samples == {'displacement': 2, 'velocity': 1}


@pytest.mark.parametrize('parameters', [{}, IDEAL])
def test_non_finite_values_are_not_hidden(parameters):
    sensor = ldv(**parameters)
    displacement, velocity = sensor.step(0, math.nan, math.inf)
    assert math.isnan(displacement)
    assert velocity == math.inf


def test_update_keeps_the_counts():
    sensor = ldv(noise=False)
    sensor.step(0, 100.0, 0.0)
    sensor.update(LdvParameters(displacement_scale=80.0, noise=False, adc_bits=0))
    assert sensor.step(1, 100.0, 0.0)[0] == pytest.approx(1.25)
    assert sensor.saturated_samples['displacement'] == 1
