"""Modes on white noise against the closed forms of the continuous process."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import welch

from hdd_servo_ros.disturbance.flutter import (
    MODE,
    FlutterParameters,
    flutter_modes,
    stationary_states,
)
from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.numerics.records import record
from hdd_servo_ros.parameters import ParameterError, from_mapping

SAMPLE_TIMES = [1e-4, 37879e-9, 19841e-9, 1e-3]


def matrices(frequency, damping, sample_time):
    """Return transition and noise factor of (y, y'/w)/sigma as the kernel uses them."""
    row = record(flutter_modes(FlutterParameters(True, 1, (frequency,), (damping,), (1.0,)), sample_time), MODE, 0)
    transition = np.array([[row.a11, row.a12], [row.a21, row.a22]])
    return transition, np.array([[row.own_noise, row.shared_noise], [0.0, row.rate_noise]])


@given(st.floats(0.5, 1e4), st.floats(1e-4, 0.99), st.sampled_from(SAMPLE_TIMES))
def test_transition_and_noise_are_those_of_the_stochastic_differential_equation(frequency, damping, sample_time):
    w = 2.0 * math.pi * frequency
    a = np.array([[0.0, w], [-w, -2.0 * damping * w]])
    intensity = np.array([[0.0, 0.0], [0.0, 4.0 * damping * w]])
    # Its stationary covariance is the unit matrix, the variance of y that of the declaration.
    assert solve_continuous_lyapunov(a, -intensity) == pytest.approx(np.eye(2), abs=1e-9)
    transition, factor = matrices(frequency, damping, sample_time)
    # expm squares its result often where a T is large: the tolerance is its own.
    assert transition == pytest.approx(expm(a * sample_time), abs=1e-9)
    assert factor @ factor.T == pytest.approx(np.eye(2) - transition @ transition.T, abs=1e-15)


@pytest.mark.parametrize('sample_time', SAMPLE_TIMES)
def test_over_a_short_time_the_noise_keeps_its_digits(sample_time):
    """The variance of y after T is (4/3) z (w T)^3 to first order, which a difference of ones loses."""
    frequency, damping = 1.0, 0.01
    _, factor = matrices(frequency, damping, sample_time)
    x = 2.0 * math.pi * frequency * sample_time
    assert (factor @ factor.T)[1, 1] == pytest.approx(4.0 * damping * x, rel=1e-2)
    assert (factor @ factor.T)[0, 1] == pytest.approx(2.0 * damping * x**2, rel=1e-2)
    assert (factor @ factor.T)[0, 0] == pytest.approx(4.0 / 3.0 * damping * x**3, rel=2e-2, abs=1e-15)


def flutter(sample_time, count, **values):
    named = {f'flutter.{name}': value for name, value in {'enabled': True, **values}.items()}
    return DisturbanceGenerator(from_mapping(DisturbanceParameters, named), sample_time).rows(0, count)[0][:, 1]


@pytest.mark.parametrize('sample_time', [1e-4, 37879e-9])
def test_variance_and_autocovariance(sample_time):
    frequency, damping, sigma = 900.0, 0.05, 0.003
    count = 400_000
    y = flutter(sample_time, count, frequencies=(frequency,), damping_ratios=(damping,), sigmas=(sigma,))
    w, root = 2.0 * math.pi * frequency, math.sqrt(1.0 - damping**2)
    # The correlation time 1/(z w) decides how many independent samples there are: their number gives the tolerance.
    independent = count * sample_time * damping * w
    tolerance = 5.0 / math.sqrt(independent)
    for lag in (0, 1, 2, 5, 10, 20):
        t = lag * sample_time
        decay = math.exp(-damping * w * t)
        expected = decay * (math.cos(root * w * t) + damping / root * math.sin(root * w * t))
        found = float(np.mean(y[: count - lag] * y[lag:])) / sigma**2
        assert found == pytest.approx(expected, abs=tolerance)


def test_the_spectrum_is_that_of_the_mode():
    """Sampled 40 times per period the density is that of the continuous mode, aliasing far below 1 dB."""
    sample_time, frequency, damping, sigma = 2.5e-5, 1000.0, 0.02, 0.002
    y = flutter(sample_time, 1 << 20, frequencies=(frequency,), damping_ratios=(damping,), sigmas=(sigma,))
    f, density = welch(y, 1.0 / sample_time, nperseg=8192)
    w, at = 2.0 * math.pi * frequency, 2.0 * math.pi * f
    # One-sided: 2 q^2 |H|^2 with q^2 = 4 z w^3 sigma^2.
    expected = 8.0 * damping * w**3 * sigma**2 / ((w**2 - at**2) ** 2 + (2.0 * damping * w * at) ** 2)
    # The resonance is 40 Hz wide, a bin of the estimate 5 Hz.
    inside = (f > 200.0) & (f < 3000.0)
    decibels = 10.0 * np.log10(density[inside] / expected[inside])
    assert abs(decibels.mean()) < 0.1
    smooth = np.convolve(decibels, np.ones(16) / 16.0, 'valid')
    assert np.abs(smooth).max() < 1.0


def test_every_mode_is_stationary_from_tick_0_and_independent():
    modes = flutter_modes(FlutterParameters(), 1e-4)
    states = np.array([stationary_states(modes, seed) for seed in range(2000)])
    # 2000 x 18 deviates: the standard deviation of each variance is 3.2 %.
    assert np.abs(states.var(axis=0) - 1.0).max() < 0.12
    correlations = np.corrcoef(states.reshape(2000, -1).T) - np.eye(18)
    assert np.abs(correlations).max() < 0.11


def test_the_default_modes_together_have_the_sigma_of_the_benchmark():
    """1.73 % of its pitch of 254 nm."""
    total = math.sqrt(sum(sigma**2 for sigma in FlutterParameters().sigmas))
    assert total == pytest.approx(0.0173 * 0.254, rel=5e-3)


@pytest.mark.parametrize('name', ['damping_ratios', 'sigmas'])
def test_lists_of_different_length_are_rejected(name):
    with pytest.raises(ParameterError, match=f'{name}: .* 9 elements, as many as frequencies'):
        from_mapping(DisturbanceParameters, {f'flutter.{name}': (0.1, 0.2)})
