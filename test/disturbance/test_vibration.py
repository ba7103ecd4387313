"""Vibration of the base: spectrum and level at every sample time, sines, sweeps, recordings."""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.signal import welch

from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping


def generator(sample_time, axis='rotational', **values):
    named = {f'vibration.{axis}.{name}': value for name, value in {'enabled': True, **values}.items()}
    return DisturbanceGenerator(from_mapping(DisturbanceParameters, named), sample_time)


def acceleration(sample_time, count, axis='rotational', **values):
    rows = generator(sample_time, axis, **values).rows(0, count)[1]
    column = {'rotational': 5, 'linear': 1}[axis]
    assert not np.delete(rows, column, axis=1).any()
    return rows[:, column]


@pytest.mark.parametrize('sample_time', [1e-4, 37879e-9, 5e-4])
@pytest.mark.parametrize(('low', 'high'), [(10.0, 500.0), (5.0, 800.0)])
def test_the_spectrum_is_within_1_db_of_the_closed_form(sample_time, low, high):
    seconds = 120.0
    a = acceleration(sample_time, int(seconds / sample_time), rms=12.5, low=low, high=high)
    # Resolution 1.25 Hz: some 290 half-overlapping segments.
    segment = int(0.8 / sample_time)
    f, density = welch(a, 1.0 / sample_time, 'hann', segment)
    w, upper, lower = (np.tan(np.pi * x * sample_time) for x in (f, high, low))
    with np.errstate(divide='ignore', over='ignore'):
        shape = 1.0 / (1.0 + (w / upper) ** 32) / (1.0 + (lower / w) ** 16)
    expected = 12.5**2 * shape / trapezoid(shape, f)
    inside = (f > low + 3.0) & (f < high - 10.0)
    decibels = 10.0 * np.log10(density[inside] / expected[inside])
    # The estimate of a bin has a standard deviation of about 0.3 dB; over 8 bins 0.1 dB.
    smooth = np.convolve(decibels, np.ones(8) / 8.0, 'valid')
    assert np.abs(smooth).max() < 1.0
    assert abs(decibels.mean()) < 0.05
    # Nearly brick-wall: 40 dB down at half of the lower edge, and at 1.4 times the upper one.
    level = density[inside].mean()
    assert density[f > 1.4 * high].max(initial=0.0) < 1e-4 * level
    f, density = welch(a, 1.0 / sample_time, 'hann', 12 * segment)
    assert density[(f > 0.5) & (f < 0.5 * low)].max() < 1e-4 * level


@pytest.mark.parametrize('sample_time', [1e-4, 37879e-9, 5e-4])
@pytest.mark.parametrize('axis', ['rotational', 'linear'])
def test_the_rms_is_the_given_one_from_tick_0_on(sample_time, axis):
    runs = [acceleration(sample_time, 40, axis, rms=2.5, seed=seed) for seed in range(1, 150)]
    # A band of 490 Hz has few independent values in 40 samples: 149 runs give a standard deviation of some 5 %.
    assert np.sqrt(np.mean(np.square(runs))) == pytest.approx(2.5, rel=0.15)
    long = acceleration(sample_time, int(60.0 / sample_time), axis, rms=2.5)
    assert long.std() == pytest.approx(2.5, rel=0.02)


def test_axes_of_one_seed_are_independent():
    values = {'enabled': True, 'rms': 1.0}
    named = {f'vibration.{axis}.{name}': value for axis in ('linear', 'rotational') for name, value in values.items()}
    rows = DisturbanceGenerator(from_mapping(DisturbanceParameters, named), 1e-4).rows(0, 300_000)[1]
    assert abs(np.corrcoef(rows[:, 1], rows[:, 5])[0, 1]) < 0.03


def test_a_sine():
    a = acceleration(1e-4, 3000, kind='sine', amplitude=3.0, frequency=123.0, phase=0.1, start_time=0.05)
    t = np.arange(3000) * 1e-4 - 0.05
    expected = np.where(t > -1e-9, 3.0 * np.sin(2.0 * np.pi * (123.0 * t + 0.1)), 0.0)
    assert a == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize('sweep', ['linear', 'logarithmic'])
def test_a_sweep_has_its_frequency_and_is_repeated_with_continuous_phase(sweep):
    first, last, duration = 20.0, 400.0, 0.5
    values = {'start_frequency': first, 'end_frequency': last, 'sweep_time': duration, 'sweep': sweep}
    t = np.arange(20_000) * 5e-5
    inside = np.mod(t, duration)
    if sweep == 'linear':
        frequency = first + (last - first) * inside / duration
    else:
        frequency = first * (last / first) ** (inside / duration)
    a = acceleration(5e-5, 20_000, kind='swept_sine', amplitude=1.0, **values)
    # The phase is the integral of the frequency, computed here with small steps.
    fine = np.arange(200_000) * 5e-6
    at = np.mod(fine, duration) / duration
    rate = first + (last - first) * at if sweep == 'linear' else first * (last / first) ** at
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 5e-6)))[::10]
    assert a == pytest.approx(np.sin(2.0 * np.pi * turns), abs=0.02)
    assert np.abs(np.diff(a)).max() <= 2.0 * np.pi * frequency.max() * 5e-5 * 1.001
    # Once, it stays at its last frequency.
    once = acceleration(5e-5, 20_000, kind='swept_sine', sweep_repeated=False, **values)
    assert once[:10_000].tobytes() == a[:10_000].tobytes()
    crossings = np.count_nonzero(np.diff(np.signbit(once[10_000:])))
    assert crossings == pytest.approx(2.0 * last * 0.5, abs=2)


@pytest.fixture
def recording(tmp_path):
    file = tmp_path / 'recording.csv'
    file.write_text('time [s],acceleration [m/s^2]\n2.0,1.0\n2.0002,3.0\n2.0005,-2.0\n')
    return str(file)


def test_a_recording(recording):
    values = {'kind': 'recording', 'recording': recording}
    expected = [1.0, 2.0, 3.0, 4.0 / 3.0, -1.0 / 3.0, -2.0]
    assert acceleration(1e-4, 8, 'linear', **values) == pytest.approx([*expected, 0.0, 0.0], abs=1e-9)
    held = acceleration(1e-4, 8, 'linear', **values, recording_interpolation='hold', recording_scale=2.0)
    assert held.tolist() == [2.0, 2.0, 6.0, 6.0, 6.0, -4.0, 0.0, 0.0]
    late = acceleration(1e-4, 10, 'rotational', **values, start_time=2e-4, recording_repeated=True)
    assert late == pytest.approx([0.0, 0.0, *expected, *expected[:2]], abs=1e-9)


@pytest.mark.parametrize(
    ('sample_time', 'values', 'reason'),
    [
        (1e-4, {'high': 5000.0}, r'vibration\.rotational\.high: 5000\.0; expected below half .*, 5000 Hz'),
        (1e-3, {}, r'vibration\.rotational\.high: 500\.0; expected below half the sampling rate, 500 Hz'),
        (1e-4, {'kind': 'sine', 'frequency': 6000.0}, r'frequency: 6000\.0; expected below half'),
        (1e-4, {'kind': 'swept_sine', 'end_frequency': 6000.0}, r'end_frequency: 6000\.0; expected below half'),
        (1e-4, {'low': 500.0}, r'low: 500\.0; expected below high, which is 500\.0'),
        (1e-4, {'low': 1e-3}, r'low: 0\.001; expected 0, or at least 0\.1 Hz with sample_time = 0\.0001 s'),
        (1e-4, {'low': 0.0, 'high': 1e-3}, r'high: 0\.001; expected at least 0\.1 Hz'),
        (1e-4, {'kind': 'recording'}, r"recording: ''; expected the path of a CSV file"),
        (1e-4, {'recording': 'nowhere.csv'}, r"recording: 'nowhere\.csv'; expected .*No such file"),
        (1e-4, {'high_order': 33}, r'high_order: 33; expected .* at most 32'),
    ],
)
def test_invalid_parameters_are_rejected(sample_time, values, reason):
    with pytest.raises(ParameterError, match=reason):
        generator(sample_time, **values)


def test_disabled_vibration_is_not_checked_against_the_sample_time():
    assert not acceleration(1e-3, 5, enabled=False).any()
