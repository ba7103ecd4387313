import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hdd_servo_ros.analysis.metrics import (
    amplitude_spectrum,
    control_effort,
    is_stepwise,
    loop_area,
    power_spectral_density,
    repeatable_parts,
    rms,
    step_response,
    tracking_metrics,
)
from hdd_servo_ros.analysis.misregistration import misregistration, misregistration_from_spectrum

T = 1e-4
finite = st.floats(-1e6, 1e6, allow_subnormal=False)


def test_of_a_sine_error():
    t = np.arange(20000) * 1e-4
    x_d = np.sin(t)
    error = 0.005 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 100.0 * t)
    x = x_d + error + 0.002
    u = np.full_like(t, 0.25)
    u[3] = -0.75
    metrics = tracking_metrics(t, x_d, x, u, transient=1.0)
    assert metrics.samples == 10000
    assert metrics.mean_error == pytest.approx(2.0)
    assert metrics.rms_error == pytest.approx(np.hypot(5.0, 2.0))
    # Three standard deviations about the mean, (1.1) and (1.2).
    assert metrics.tmr == pytest.approx(15.0, rel=1e-4)
    assert metrics.max_error == pytest.approx(5.0 * np.sqrt(2.0) + 2.0, rel=1e-3)
    assert metrics.peak_control == 0.75
    assert metrics.rms_control == pytest.approx(0.25)


def test_the_transient_ends_with_its_tick():
    t = np.arange(10) * 1e-4
    x = np.where(np.arange(10) < 5, 1.0, 0.0)
    assert tracking_metrics(t, np.zeros(10), x, x, transient=5e-4).max_error == 0.0
    assert tracking_metrics(t, np.zeros(10), x, x, transient=4e-4).max_error == 1000.0


def test_other_units():
    assert tracking_metrics([0.0], [0.0], [2.0], [0.0], unit=1.0).rms_error == 2.0


def test_what_is_rejected():
    with pytest.raises(ValueError, match='transient'):
        tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], transient=2.0)
    with pytest.raises(ValueError, match='shape'):
        tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.0], [0.0, 0.0])


@pytest.mark.parametrize('segment', [None, 1000])
def test_misregistration_from_time_record_and_from_spectrum_agree(segment):
    """(1.1) and (1.2) for a sine, a step of the mean and noise together."""
    t = np.arange(100_000) * T
    noise = np.random.default_rng(3).normal(0.0, 0.4, len(t))
    error = 5.0 + 2.0 * np.sin(2.0 * np.pi * 130.0 * t) + noise
    frequencies, density = power_spectral_density(error, T, segment)
    expected = 3.0 * np.sqrt(2.0 + 0.16)  # closed form: variances of a sine and of the noise
    # The periodogram holds the record's own variance; Welch's segments estimate it.
    tolerance = 1e-4 if segment is None else 0.02
    assert misregistration_from_spectrum(frequencies, density) == pytest.approx(misregistration(error), rel=tolerance)
    assert misregistration(error) == pytest.approx(expected, rel=0.01)


def test_amplitude_spectrum_reads_the_amplitude_of_a_sine_at_its_frequency():
    t = np.arange(50_000) * T
    frequencies, amplitudes = amplitude_spectrum(
        3.0 + 0.7 * np.sin(2.0 * np.pi * 300.0 * t) + 0.02 * np.cos(2.0 * np.pi * 900.0 * t), T
    )
    peaks = {300.0: 0.7, 900.0: 0.02, 500.0: 0.0}
    for frequency, amplitude in peaks.items():
        assert amplitudes[np.argmin(np.abs(frequencies - frequency))] == pytest.approx(amplitude, rel=1e-6, abs=1e-6)
    assert frequencies[1] == pytest.approx(1.0)
    short, _ = amplitude_spectrum(np.sin(np.arange(20.0)), T)
    assert short[1] == pytest.approx(500.0)


@pytest.mark.parametrize('off', [0.0, 0.1, 0.25, 0.5])
def test_a_peak_of_the_amplitude_spectrum_reads_the_amplitude_between_two_lines(off):
    """A Hann window reads 0.849 for a unit sine midway between two lines."""
    t = np.arange(50_000) * T
    frequencies, amplitudes = amplitude_spectrum(np.sin(2.0 * np.pi * (300.0 + off) * t + 0.3), T)
    assert amplitudes.max() == pytest.approx(1.0, rel=2e-3)
    assert abs(frequencies[np.argmax(amplitudes)] - 300.0 - off) < 0.51
    # As wide as the docstring states; the mean of a segment that ends within a period is not zero.
    beside = (np.abs(frequencies - 300.0 - off) > 5.0) & (frequencies > 10.0)
    assert amplitudes[beside].max() < 1e-3


@pytest.mark.parametrize(('period', 'samples'), [(100.0, 100), (200.0 / 3.0, 200)])
def test_repeatable_and_non_repeatable_parts(period, samples):
    ticks = np.arange(40_123)
    repeatable = 3.0 * np.sin(2.0 * np.pi * ticks / period + 0.3) + 1.0 * np.cos(6.0 * np.pi * ticks / period) + 0.5
    noise = np.random.default_rng(5).normal(0.0, 0.8, len(ticks))
    parts = repeatable_parts(repeatable + noise, period)
    assert (parts.period, parts.cycles) == (samples, 40_123 // samples)
    # A sine of 3, one of 1 and a mean of 0.5; averaging leaves 1/cycles of the noise's variance.
    assert parts.repeatable_rms == pytest.approx(np.sqrt(4.5 + 0.5 + 0.25), rel=0.01)
    assert parts.non_repeatable_rms == pytest.approx(0.8, rel=0.02)
    np.testing.assert_allclose(parts.waveform, repeatable[:samples], atol=5.0 * 0.8 / np.sqrt(parts.cycles))


@given(arrays(np.float64, st.integers(40, 200), elements=finite), st.integers(1, 20))
def test_the_parts_add_up_to_the_signal(signal, period):
    parts = repeatable_parts(signal, float(period))
    used = signal[len(signal) - parts.period * parts.cycles :]
    assert parts.repeatable_rms**2 + parts.non_repeatable_rms**2 == pytest.approx(rms(used) ** 2, rel=1e-9, abs=1e-6)


def test_a_signal_shorter_than_two_periods_is_rejected():
    with pytest.raises(ValueError, match='two periods of 100 samples; the signal has 199'):
        repeatable_parts(np.zeros(199), 100.0)


def test_step_response_of_a_second_order_system():
    """Overshoot exp(-pi zeta/sqrt(1 - zeta^2)), in closed form; the envelope is 2 % at `envelope`."""
    zeta, w = 0.5, 2.0 * np.pi * 200.0
    t = np.arange(4001) * 1e-5
    t_in = t[1000:] - t[1000]
    damped = w * np.sqrt(1.0 - zeta**2)
    answer = 1.0 - np.exp(-zeta * w * t_in) * (np.cos(damped * t_in) + zeta * w / damped * np.sin(damped * t_in))
    x = np.concatenate((np.zeros(1000), 5.0 * answer)) + 0.001
    x_d = np.where(np.arange(len(t)) < 1000, 0.0, 5.0)
    response = step_response(t, x_d, x)
    assert response.row.tolist() == [1000]
    assert response.height.tolist() == [5.0]
    overshoot = 100.0 * np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert response.overshoot[0] == pytest.approx(overshoot, abs=0.05)
    envelope = np.log(1.0 / (0.02 * np.sqrt(1.0 - zeta**2))) / (zeta * w)
    assert 0.7 * envelope < response.settling_time[0] <= envelope
    assert response.steady_error[0] == pytest.approx(0.001, abs=1e-4)


def test_step_responses_of_a_square_wave():
    t = np.arange(400) * T
    x_d = np.where(np.arange(400) // 100 % 2 == 0, 1.0, -1.0)
    x = x_d.copy()
    x[0] = 0.0  # the wave stands at 1 from its first tick on: an edge from where the head is
    x[100:105] = 0.0  # half way for 5 ticks
    x[200] = 1.5  # 25 % beyond
    x[300:] = -0.9  # never within 2 % of 2
    response = step_response(t, x_d, x)
    assert response.row.tolist() == [0, 100, 200, 300]
    assert response.height.tolist() == [1.0, -2.0, 2.0, -2.0]
    np.testing.assert_allclose(response.overshoot, [0.0, 0.0, 25.0, 0.0])
    np.testing.assert_allclose(response.settling_time, [1e-4, 5e-4, 1e-4, np.inf])
    np.testing.assert_allclose(response.steady_error, [0.0, 0.0, 0.0, 0.1], atol=1e-12)
    assert response.worst() == pytest.approx({'overshoot': 25.0, 'settling_time': np.inf, 'steady_error': 0.1})
    assert response.median() == pytest.approx({'overshoot': 0.0, 'settling_time': 3e-4, 'steady_error': 0.0})
    assert len(response) == 4


@pytest.mark.parametrize(
    ('reference', 'match'),
    [(np.sin(np.arange(100.0)), 'neither a step nor a square'), (np.zeros(100), 'has no edge')],
)
def test_a_reference_without_edges_has_no_step_response(reference, match):
    with pytest.raises(ValueError, match=match):
        step_response(np.arange(100) * T, reference, np.zeros(100))
    assert is_stepwise(np.zeros(10))
    assert not is_stepwise(np.arange(10.0))


@given(arrays(np.float64, st.integers(1, 50), elements=finite))
def test_control_effort(control):
    effort = control_effort(control)
    assert effort.peak == max(abs(value) for value in control)
    assert effort.rms <= effort.peak * (1.0 + 1e-12)
    steps = [abs(b - a) for a, b in itertools.pairwise(control)]
    assert effort.total_variation == pytest.approx(sum(steps))


@given(st.floats(0.1, 100.0), st.floats(0.1, 100.0), st.floats(-3.0, 3.0), st.integers(1, 5))
def test_the_area_of_an_ellipse(a, b, phase, cycles):
    angle = np.arange(4000 * cycles) * 2.0 * np.pi / 4000
    x, f = a * np.sin(angle), b * np.cos(angle + phase)
    # Closed form: pi a b cos(phase); a force in phase with the velocity does positive work.
    assert loop_area(x, f, cycles) == pytest.approx(np.pi * a * b * np.cos(phase), abs=1e-5 * a * b)
