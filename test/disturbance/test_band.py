"""The steep band against scipy's Butterworth filters, and its variance against theirs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from hdd_servo_ros.disturbance.band import (
    band_power,
    band_sections,
    filtered,
    run_in_ticks,
    stationary_band,
    warped,
)
from hdd_servo_ros.numerics.noise import normal_pair

SAMPLE_TIMES = [1e-4, 37879e-9, 19841e-9]


def with_ones(sections):
    """Return sections as scipy has them: with a0."""
    return np.column_stack((sections[:, :3], np.ones(len(sections)), sections[:, 3:]))


def of_scipy(low, high, low_order, high_order, sample_time):
    high_pass = signal.butter(low_order, low, 'highpass', fs=1.0 / sample_time, output='sos')
    low_pass = signal.butter(high_order, high, 'lowpass', fs=1.0 / sample_time, output='sos')
    return np.concatenate((high_pass, low_pass))


@settings(max_examples=60)
@given(
    st.floats(0.5, 100.0),
    st.floats(1.2, 40.0),
    st.integers(1, 32),
    st.integers(1, 32),
    st.sampled_from(SAMPLE_TIMES),
)
def test_the_response_is_that_of_scipy_and_of_the_closed_form(low, ratio, low_order, high_order, sample_time):
    high = min(low * ratio, 0.45 / sample_time)
    frequencies = np.geomspace(0.7 * low, min(1.5 * high, 0.49 / sample_time), 60)
    sections = with_ones(band_sections(low, high, low_order, high_order, sample_time))
    _, found = signal.freqz_sos(sections, frequencies, fs=1.0 / sample_time)
    w = np.tan(np.pi * frequencies * sample_time)
    closed = 1.0 / (1.0 + (w / warped(high, sample_time)) ** (2 * high_order))
    closed = closed / (1.0 + (warped(low, sample_time) / w) ** (2 * low_order))
    # Poles close to z = 1 lose digits, in scipy as well.
    assert np.abs(found) ** 2 == pytest.approx(closed, rel=2e-4, abs=1e-12)
    _, expected = signal.freqz_sos(
        of_scipy(low, high, low_order, high_order, sample_time), frequencies, fs=1.0 / sample_time
    )
    assert np.abs(found) == pytest.approx(np.abs(expected), rel=2e-4, abs=1e-12)


@settings(max_examples=12)
@given(
    st.floats(20.0, 500.0), st.floats(1.5, 8.0), st.integers(1, 24), st.integers(1, 24), st.sampled_from(SAMPLE_TIMES)
)
def test_the_variance_is_that_of_the_impulse_response(low, ratio, low_order, high_order, sample_time):
    high = min(low * ratio, 0.45 / sample_time)
    impulse = np.zeros(150_000)
    impulse[0] = 1.0
    response = signal.sosfilt(of_scipy(low, high, low_order, high_order, sample_time), impulse)
    found = band_power(low, high, low_order, high_order, sample_time)
    assert found == pytest.approx(float(np.sum(response**2)), rel=1e-7)


@pytest.mark.parametrize('order', [1, 2, 5, 16, 32])
@pytest.mark.parametrize('high', [30.0, 500.0, 4900.0])
def test_without_a_lower_edge(order, high):
    impulse = np.zeros(50_000)
    impulse[0] = 1.0
    low_pass = signal.butter(order, high, 'lowpass', fs=1e4, output='sos')
    sections = band_sections(0.0, high, 8, order, 1e-4)
    assert len(sections) == (order + 1) // 2
    _, found = signal.freqz_sos(with_ones(sections), 200, fs=1e4)
    _, expected = signal.freqz_sos(low_pass, 200, fs=1e4)
    assert np.abs(found) == pytest.approx(np.abs(expected), rel=1e-4, abs=1e-12)
    expected_power = float(np.sum(signal.sosfilt(low_pass, impulse) ** 2))
    assert band_power(0.0, high, 8, order, 1e-4) == pytest.approx(expected_power, rel=1e-7)


def test_one_sample_after_the_other_is_sosfilt():
    sections = band_sections(10.0, 500.0, 8, 16, 1e-4)
    x = np.random.default_rng(1).normal(size=500)
    states = np.zeros((len(sections), 2))
    found = [filtered(sections, states, value) for value in x.tolist()]
    assert found == pytest.approx(signal.sosfilt(with_ones(sections), x), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(('low', 'low_order'), [(10.0, 8), (10.0, 3), (200.0, 16), (0.0, 8)])
def test_before_tick_0_the_filter_has_run_long_enough(low, low_order):
    """After the run-in the states do not change any more, checked by the rest of an impulse response."""
    band = (low, 500.0, low_order, 16, 1e-4)
    sections = band_sections(*band[:4], 1e-4)
    ticks = run_in_ticks(*band)
    impulse = np.zeros(ticks + 1)
    impulse[0] = 1.0
    response = np.abs(signal.sosfilt(with_ones(sections), impulse))
    assert response[-1] < 1e-6 * response.max()
    states = stationary_band(sections, 5, 7, ticks)
    noise = [normal_pair(5, 7, tick)[0] for tick in range(ticks)]
    _, expected = signal.sosfilt(with_ones(sections), noise, zi=np.zeros((len(sections), 2)))
    assert states == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert math.isfinite(states.sum())
