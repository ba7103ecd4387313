"""The accelerometers against scipy's discretization of the same filters, and each error by itself."""

from typing import Any

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.bench.accelerometer import Accelerometer, AccelerometerParameters

SAMPLE_TIME = 1e-4
PERFECT: dict[str, Any] = {'noise': 0.0, 'adc_bits': 0, 'output_range': 0.0}


def readings(accelerometer, linear, angular=None, control=None):
    """Outputs [V], shape (n, 2), for the accelerations held from each tick on."""
    count = len(linear)
    held = np.zeros((count, 3))
    for column, values in enumerate((linear, angular, control)):
        if values is not None:
            held[1:, column] = values[:-1]
    return np.array([accelerometer.step(tick, *held[tick]) for tick in range(count)])


def filtered(acceleration, bandwidth, damping=0.707, beam=0.0, sample_time=SAMPLE_TIME):
    """The same acceleration after the same filters, by scipy."""
    low = 2.0 * np.pi * bandwidth
    numerator, denominator = [low**2], np.array([1.0, 2.0 * damping * low, low**2])
    if beam:
        w = 2.0 * np.pi * beam
        numerator, denominator = [low**2 * w**2], np.polymul(denominator, [1.0, 2.0 * 0.02 * w, w**2])
    b, a, _ = signal.cont2discrete((numerator, denominator), sample_time, 'zoh')
    return signal.lfilter(b[0], a, acceleration)


@pytest.mark.parametrize('beam', [0.0, 2500.0])
@pytest.mark.parametrize('sample_time', [1e-4, 37.879e-6])
def test_filters_are_exact_for_an_acceleration_that_is_held(beam, sample_time):
    acceleration = np.random.default_rng(1).normal(size=500)
    sensors = Accelerometer(AccelerometerParameters(**PERFECT, bandwidth=1000.0, beam_frequency=beam), sample_time)
    found = readings(sensors, acceleration)
    wanted = 0.1 * filtered(acceleration, 1000.0, beam=beam, sample_time=sample_time)
    np.testing.assert_allclose(found[:, 0], wanted, atol=1e-12)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])


def test_a_rotation_is_half_the_difference_over_half_the_distance():
    angular = np.full(200, 12.5)
    sensors = Accelerometer(AccelerometerParameters(**PERFECT, bandwidth=3000.0, separation=0.08), SAMPLE_TIME)
    x, y = readings(sensors, np.full(200, 2.0), angular)[-1]
    assert (x - y) / (0.1 * 0.08) == pytest.approx(12.5)
    assert (x + y) / (2.0 * 0.1) == pytest.approx(2.0)


def test_the_reaction_of_the_actuator_acts_like_a_rotation():
    sensors = Accelerometer(AccelerometerParameters(**PERFECT, parasitic_gain=20.0), SAMPLE_TIME)
    x, y = readings(sensors, np.zeros(200), control=np.full(200, 0.5))[-1]
    assert (x, y) == (pytest.approx(1.0), pytest.approx(-1.0))


def test_gain_error_mismatch_and_offset():
    parameters = AccelerometerParameters(**PERFECT, gain_error=0.125, gain_mismatch=0.1, offset=0.01)
    x, y = readings(Accelerometer(parameters, SAMPLE_TIME), np.ones(300))[-1]
    assert x == pytest.approx(0.1 * 1.175 + 0.01)
    assert y == pytest.approx(0.1 * 1.075 + 0.01)


def test_noise_has_its_rms_value_and_depends_on_seed_and_tick_alone():
    parameters = AccelerometerParameters(adc_bits=0, noise=0.02, seed=7)
    noise = readings(Accelerometer(parameters, SAMPLE_TIME), np.zeros(20_000)) / 0.1
    assert noise.std(axis=0) == pytest.approx(0.02, rel=0.03)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.03
    later = Accelerometer(parameters, SAMPLE_TIME)
    assert later.step(123, 0.0, 0.0, 0.0) == tuple(noise[123] * 0.1)


def test_a_delay_of_a_sample():
    acceleration = np.random.default_rng(2).normal(size=100)
    prompt = readings(Accelerometer(AccelerometerParameters(**PERFECT), SAMPLE_TIME), acceleration)
    late = readings(Accelerometer(AccelerometerParameters(**PERFECT, delay=1), SAMPLE_TIME), acceleration)
    np.testing.assert_array_equal(late[1:], prompt[:-1])
    np.testing.assert_array_equal(late[0], [0.0, 0.0])


def test_range_and_converter_clip_and_count():
    sensors = Accelerometer(AccelerometerParameters(noise=0.0, output_range=5.0, adc_bits=8), SAMPLE_TIME)
    found = readings(sensors, np.full(100, 80.0))
    assert found.max() == pytest.approx(5.0, abs=10.0 / 128)
    assert sensors.saturated_samples['x'] == int((found[:, 0] == found.max()).sum())
    (warning,) = {text.split(':')[0].split(' at tick')[0] for text in [sensors.saturation_warnings()['x']]}
    assert warning == 'output x saturates'
    steps = found[:, 0] / (10.0 / 128)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)


def test_an_update_keeps_the_motion():
    acceleration = np.random.default_rng(3).normal(size=60)
    sensors = Accelerometer(AccelerometerParameters(**PERFECT), SAMPLE_TIME)
    first = readings(sensors, acceleration[:30])
    sensors.update(AccelerometerParameters(**PERFECT, gain_error=0.5))
    second = sensors.step(30, acceleration[29], 0.0, 0.0)[0]
    wanted = 0.1 * filtered(acceleration, 1000.0)[:31]
    np.testing.assert_allclose(first[:, 0], wanted[:30], atol=1e-12)
    assert second == pytest.approx(1.5 * wanted[30])
