"""The reference: closed forms, and derivatives against differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import chirp

from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.signals.reference import Reference, ReferenceParameters

T = 1e-4


def rows(ticks, sample_time=T, **parameters):
    reference = Reference(ReferenceParameters(**parameters), sample_time)
    return np.array([reference.step(int(tick)) for tick in ticks])


def test_default_is_the_sine_of_chapter_5():
    t = np.arange(3000) * T
    w = 2.0 * math.pi * 100.0
    expected = np.stack([2.0 * np.sin(w * t), 2.0 * w * np.cos(w * t), -2.0 * w * w * np.sin(w * t)], axis=1)
    result = rows(range(3000))
    np.testing.assert_allclose(result / [2.0, 2.0 * w, 2.0 * w * w], expected / [2.0, 2.0 * w, 2.0 * w * w], atol=1e-12)


def test_a_sine_keeps_its_exactness_for_an_hour():
    tick = 3600 * 10000 + 25
    assert rows([tick])[0, 0] == pytest.approx(2.0, abs=1e-9)


def test_phase_counts_in_turns():
    np.testing.assert_allclose(rows(range(10), phase=0.25, offset=1.0)[0], [3.0, 0.0, -2.0 * (200.0 * math.pi) ** 2])


@pytest.mark.parametrize('frequency', [5.0, 10.0, 80.0, 100.0, 300.0])
@pytest.mark.parametrize('start', [0, 1000, 3000])
def test_square_has_its_edges_at_their_ticks(frequency, start):
    ticks = np.arange(start, 30000)
    result = rows(ticks, waveform='square', frequency=frequency, amplitude=0.5, offset=0.25, start_time=start / 10000)
    # In whole numbers: tick k is in the first half of its period when 2 k f mod 2/T < 1/T.
    high = (2 * (ticks - start) * int(frequency)) % 20000 < 10000
    np.testing.assert_array_equal(result[:, 0], np.where(high, 0.75, -0.25))
    assert not result[:, 1:].any()


def test_duty_cycle():
    result = rows(range(1000), waveform='square', frequency=10.0, duty_cycle=0.2, amplitude=1.0)
    assert np.count_nonzero(result[:, 0] > 0.0) == 200


def test_step_rises_at_its_tick():
    result = rows(range(100), waveform='step', amplitude=5.0, offset=1.0, start_time=0.007)
    np.testing.assert_array_equal(result[:, 0], np.where(np.arange(100) < 70, 1.0, 6.0))
    assert not result[:, 1:].any()


def test_before_the_start_the_reference_rests_at_its_offset():
    for waveform in ('sine', 'square', 'ramp', 'chirp', 'multisine'):
        result = rows(range(50), waveform=waveform, start_time=0.005, offset=-0.5, phase=0.1)
        np.testing.assert_array_equal(result, np.tile([-0.5, 0.0, 0.0], (50, 1)))


def test_ramp_rises_and_holds():
    result = rows(range(300), waveform='ramp', slope=-100.0, amplitude=1.0, offset=2.0)
    np.testing.assert_allclose(result[:, 0], np.maximum(2.0 - 100.0 * np.arange(300) * T, 1.0), atol=1e-12)
    np.testing.assert_array_equal(result[:, 1], np.where(np.arange(300) < 100, -100.0, 0.0))


@pytest.mark.parametrize('method', ['linear', 'logarithmic'])
def test_chirp_against_scipy(method):
    count = 5000
    result = rows(
        range(count), waveform='chirp', sweep=method, frequency=20.0, end_frequency=400.0, sweep_time=0.5, phase=-0.25
    )
    expected = chirp(np.arange(count) * T, 20.0, 0.5, 400.0, method=method, phi=180.0)
    np.testing.assert_allclose(result[:, 0], 2.0 * expected, atol=1e-9)


def test_chirp_holds_its_last_frequency_with_continuous_phase():
    ticks = np.arange(4990, 5400)
    result = rows(ticks, waveform='chirp', frequency=20.0, end_frequency=400.0, sweep_time=0.5)
    spectrum = np.abs(np.fft.rfft(result[20:270, 0]))
    assert np.argmax(spectrum) == 10  # 400 Hz in 25 ms
    # A jump in phase would exceed what the velocity allows between two ticks.
    assert np.abs(np.diff(result[:, 0])).max() <= 2.0 * 2.0 * math.pi * 400.0 * T


def test_multisine_is_the_sum_of_its_sines():
    parts = [(1.0, 1.0, 0.0), (0.5, 3.0, 0.25), (-0.2, 7.5, 0.1)]
    together = rows(
        range(500),
        waveform='multisine',
        frequency=40.0,
        phase=0.05,
        offset=0.3,
        component_amplitudes=tuple(part[0] for part in parts),
        component_frequencies=tuple(part[1] for part in parts),
        component_phases=tuple(part[2] for part in parts),
    )
    alone = sum(rows(range(500), amplitude=2.0 * a, frequency=40.0 * f, phase=0.05 + p) for a, f, p in parts)
    alone[:, 0] += 0.3
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-9)


def test_constant():
    np.testing.assert_array_equal(rows([0, 5], waveform='constant', offset=1.5), [[1.5, 0.0, 0.0]] * 2)


@settings(max_examples=40)
@given(
    waveform=st.sampled_from(['sine', 'chirp', 'multisine']),
    sweep=st.sampled_from(['linear', 'logarithmic']),
    frequency=st.floats(0.5, 300.0),
    phase=st.floats(-1.0, 1.0),
    tick=st.integers(10, 20000),
)
def test_derivatives_agree_with_differences(waveform, sweep, frequency, phase, tick):
    step = 1e-7
    result = rows(
        [1000 * tick - 1, 1000 * tick, 1000 * tick + 1],
        sample_time=step,
        waveform=waveform,
        sweep=sweep,
        frequency=frequency,
        end_frequency=350.0,
        sweep_time=3.0,
        phase=phase,
        component_amplitudes=(1.0, -0.5),
        component_frequencies=(1.0, 2.0),
        component_phases=(0.0, 0.3),
    )
    velocity = (result[2, 0] - result[0, 0]) / (2.0 * step)
    acceleration = (result[2, 1] - result[0, 1]) / (2.0 * step)
    # Velocities reach 8e3 um/s, accelerations 3e7 um/s^2; the differences' own errors are below half of this.
    assert result[1, 1] == pytest.approx(velocity, abs=0.01)
    assert result[1, 2] == pytest.approx(acceleration, abs=5.0)


@pytest.mark.parametrize(
    ('name', 'parameters'),
    [
        ('component_phases', {'component_phases': (0.0, 0.1)}),
        ('component_frequencies', {'component_frequencies': ()}),
        ('frequency', {'waveform': 'chirp', 'sweep': 'logarithmic', 'frequency': 0.0}),
        ('end_frequency', {'waveform': 'chirp', 'sweep': 'logarithmic', 'end_frequency': 0.0}),
        ('slope', {'waveform': 'ramp', 'slope': 0.0}),
        ('waveform', {'waveform': 'sawtooth'}),
    ],
)
def test_invalid_parameters_are_rejected(name, parameters):
    with pytest.raises(ParameterError, match=name):
        ReferenceParameters(**parameters)


def test_update_goes_on_in_time():
    reference = Reference(ReferenceParameters(), T)
    reference.update(ReferenceParameters(amplitude=1.0))
    assert reference.step(25)[0] == pytest.approx(1.0)
