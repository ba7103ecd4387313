"""Measures of seeks on responses whose every number is known."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import periodogram

from hdd_servo_ros.analysis.seek_metrics import (
    FOLLOW,
    SEEK,
    SETTLE,
    Seek,
    access_times,
    find_seeks,
    residual_spectrum,
    returns_to_earlier_modes,
    seek_responses,
    targets_over_time,
)

T = 1e-4


def one_response(position, *, velocity=None, control=None, seek=None, tolerance=0.1, **options):
    """Return the response of a seek of 10 um from row 0 on."""
    position = np.asarray(position, dtype=float)
    none = np.zeros_like(position)
    (found,) = seek_responses(
        [seek or Seek(0, 0.0, 10.0)],
        position,
        none if velocity is None else velocity,
        none if control is None else control,
        T,
        tolerance,
        **options,
    )
    return found


def decaying(rate=2000.0, frequency=500.0, rows=400, length=10.0):
    """Return a second-order response to a step of ``length``: error -length exp(-rate t) cos(2 pi f t)."""
    t = T * np.arange(rows)
    return length - length * np.exp(-rate * t) * np.cos(2.0 * np.pi * frequency * t)


def test_a_monotonic_approach_arrives_when_the_logarithm_says():
    # The error is 10 exp(-2000 t): within 0.1 from ln(100)/2000 = 2.303 ms on.
    found = one_response(decaying(frequency=0.0))
    assert found.first_entry == found.first_arrival == found.seek_time == pytest.approx(2.4e-3)
    assert found.settling_time == 0.0
    assert found.overshoot == 0.0
    assert found.has_arrived
    assert found.watched == pytest.approx(0.04)


def test_a_ringing_approach_enters_before_it_stays():
    position = decaying(rate=800.0)
    found = one_response(position)
    error = position - 10.0
    inside = np.abs(error) <= 0.1
    last_outside = np.flatnonzero(~inside)[-1]
    assert found.seek_time == pytest.approx(T * (last_outside + 1))
    assert found.first_entry == pytest.approx(T * np.flatnonzero(inside)[0])
    assert found.first_entry < found.seek_time
    assert found.settling_time == pytest.approx(found.seek_time - found.first_entry)
    # The first crest beyond the target: exp(-800 t) at 2 pi 500 t = pi - atan(800/(2 pi 500)), between samples.
    angle = 2.0 * np.pi * 500.0
    crest = (math.pi - math.atan(800.0 / angle)) / angle
    assert found.overshoot == pytest.approx(-10.0 * math.exp(-800.0 * crest) * math.cos(angle * crest), rel=5e-3)


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(1, 6), st.none() | st.integers(0, 20))
def test_arrival_is_that_of_a_text_search(flags, samples, stay):
    """Once with the definition in words, by a regular expression."""
    found = one_response(
        np.where(flags, 10.05, 10.2), samples=samples, stay=None if stay is None else stay * T, tolerance=0.1
    )
    text = ''.join('i' if flag else 'o' for flag in flags)
    first = re.search('i' * samples, text)
    assert found.first_arrival == (math.inf if first is None else pytest.approx(first.start() * T))
    pattern = f'i{{{samples},}}$' if stay is None else f'i{{{max(stay, samples)}}}|i{{{samples},}}$'
    last = re.search(pattern, text)
    assert found.seek_time == (math.inf if last is None else pytest.approx(last.start() * T))
    entry = text.find('i')
    assert found.first_entry == (math.inf if entry < 0 else pytest.approx(entry * T))
    assert found.has_arrived == (last is not None)


@pytest.mark.parametrize('value', [0.0, math.nan, math.inf])
def test_a_head_that_never_arrives_says_so(value):
    found = one_response(np.full(200, value))
    assert found.seek_time == found.first_arrival == found.first_entry == found.settling_time == math.inf
    assert not found.has_arrived
    assert math.isnan(found.residual_peak)
    assert math.isnan(found.residual_frequency)
    assert found.overshoot == (0.0 if value == 0.0 else math.inf)


def test_a_head_that_leaves_after_its_arrival_has_not_stayed():
    position = np.full(300, 10.0)
    position[:10] = 0.0
    position[250] = 10.3
    found = one_response(position)
    assert found.first_arrival == pytest.approx(10 * T)
    assert found.seek_time == pytest.approx(251 * T)
    # It counts for the time that is asked for only.
    assert one_response(position, stay=5e-3).seek_time == pytest.approx(10 * T)
    position[-2:] = 10.3
    assert one_response(position).seek_time == math.inf


def test_residual_vibration_of_a_known_sine():
    t = T * np.arange(400)
    position = np.where(t < 2e-3, 0.0, 10.0 + 0.02 + 0.03 * np.sin(2.0 * np.pi * 1200.0 * t))
    found = one_response(position)
    assert found.seek_time == pytest.approx(2e-3)
    assert found.residual_frequency == pytest.approx(1200.0)
    assert found.residual_rms == pytest.approx(0.03 / math.sqrt(2.0), rel=1e-2)
    assert found.residual_peak == pytest.approx(0.05, rel=1e-2)
    frequencies, amplitudes = residual_spectrum(position[20:120] - 10.0, T)
    assert np.diff(frequencies) == pytest.approx(100.0)
    assert amplitudes.max() == pytest.approx(0.03, rel=1e-2)


def test_a_sine_between_two_lines_reads_15_percent_low_at_most():
    t = T * np.arange(100)
    for frequency in np.linspace(1200.0, 1300.0, 11):
        amplitudes = residual_spectrum(np.sin(2.0 * np.pi * frequency * t), T)[1]
        assert 0.84 < amplitudes.max() < 1.01
    with pytest.raises(ValueError, match='at least 4'):
        residual_spectrum(np.zeros(3), T)


@pytest.mark.parametrize('count', [4, 99, 100])
def test_the_spectrum_is_that_of_scipy(count):
    error = np.random.default_rng(1).normal(size=count) + np.arange(count)
    frequencies, power = periodogram(error, fs=1.0 / T, window='hann', detrend='linear', scaling='spectrum')
    # Its power is that of a sine, whose amplitude is sqrt 2 times its rms; but at the Nyquist frequency.
    expected = np.sqrt(2.0 * power)
    if count % 2 == 0:
        expected[-1] /= math.sqrt(2.0)
    found = residual_spectrum(error, T)
    assert found[0] == pytest.approx(frequencies[1:])
    assert found[1] == pytest.approx(expected[1:], rel=1e-9, abs=1e-12)


def test_a_trend_is_not_a_vibration():
    amplitudes = residual_spectrum(np.linspace(0.0, 1.0, 100), T)[1]
    assert amplitudes.max() < 1e-12


def test_control_and_jerk_count_until_the_arrival():
    t = T * np.arange(300)
    # The velocity is 3 s^3/um/s^4 t^2 up to 10 ms: a constant jerk.
    velocity = np.where(t <= 1e-2, 3e6 * t**2, 1e5)
    control = np.where(t < 5e-3, 4.0, -2.0)
    control[200:] = 9.0
    position = np.where(t < 1e-2, 0.0, 10.0)
    found = one_response(position, velocity=velocity, control=control)
    assert found.seek_time == pytest.approx(1e-2)
    assert found.peak_control == 4.0
    assert found.rms_control == pytest.approx(math.sqrt(0.5 * (16.0 + 4.0)))
    assert found.peak_jerk == pytest.approx(6e6)
    assert found.rms_jerk == pytest.approx(6e6)


def test_settling_counts_from_the_switch_of_modes():
    position = decaying(rate=800.0)
    arrival = one_response(position).seek_time
    modes = np.full(len(position), FOLLOW)
    modes[0:12], modes[12:60] = SEEK, SETTLE
    assert one_response(position, modes=modes).settling_time == pytest.approx(arrival - 12 * T)
    # A switch after the arrival leaves nothing to settle.
    modes[:200] = SEEK
    modes[200:210] = SETTLE
    assert one_response(position, modes=modes).settling_time == 0.0
    # Modes without a switch tell nothing.
    plain = one_response(position)
    assert one_response(position, modes=np.zeros(len(position))).settling_time == plain.settling_time


def test_seeks_in_both_directions_are_mirror_images():
    up = decaying(rate=800.0)
    (first, second) = seek_responses(
        [Seek(0, 0.0, 10.0), Seek(400, 10.0, 0.0)],
        np.concatenate([up, 10.0 - up]),
        np.zeros(800),
        np.zeros(800),
        T,
        0.1,
    )
    assert second.time == pytest.approx(0.04)
    assert (first.seek.length, second.seek.length) == (10.0, -10.0)
    as_first = dataclasses.replace(second, seek=first.seek, time=first.time)
    assert dataclasses.astuple(as_first)[1:] == pytest.approx(dataclasses.astuple(first)[1:])


def test_what_cannot_be_measured_is_rejected():
    x = np.zeros(10)
    assert seek_responses([], x, x, x, T, 0.1) == []
    seek = [Seek(0, 0.0, 1.0)]
    with pytest.raises(ValueError, match='different shape'):
        seek_responses(seek, x, x[1:], x, T, 0.1)
    with pytest.raises(ValueError, match='different shape'):
        seek_responses(seek, x, x, x, T, 0.1, modes=x[1:])
    for rows in ([3, 3], [5, 2], [10], [-1]):
        with pytest.raises(ValueError, match='ascending'):
            seek_responses([Seek(row, 0.0, 1.0) for row in rows], x, x, x, T, 0.1)
    for tolerance in (0.0, math.nan):
        with pytest.raises(ValueError, match='tolerance'):
            seek_responses(seek, x, x, x, T, tolerance)
    with pytest.raises(ValueError, match='expected at least 1'):
        seek_responses(seek, x, x, x, T, 0.1, samples=0)
    with pytest.raises(ValueError, match='time on target'):
        seek_responses(seek, x, x, x, T, 0.1, stay=-1.0)


def test_jumps_are_found_at_the_row_that_has_the_new_target():
    x_d = np.repeat([0.0, 5.0, 5.0, -2.0], 10)
    found = find_seeks(x_d, np.zeros(40), along_trajectory=False)
    assert found == [Seek(10, 0.0, 5.0), Seek(30, 5.0, -2.0)]
    assert np.array_equal(targets_over_time(found, 0.0, 40), x_d)
    assert find_seeks(np.ones(5), np.zeros(5), along_trajectory=False) == []
    assert targets_over_time([], 1.0, 3) == pytest.approx([1.0, 1.0, 1.0])


def minimum_jerk(length, samples):
    """Return x_d and dx_d/dt of a minimum-jerk trajectory, from its origin at rest to the first sample at its end."""
    s = np.arange(samples + 1) / samples
    return length * s**3 * (10.0 - 15.0 * s + 6.0 * s**2), length * 30.0 * s**2 * (1.0 - s) ** 2 / (samples * T)


@given(st.lists(st.tuples(st.floats(0.1, 100.0), st.booleans(), st.integers(1, 30), st.integers(0, 5)), max_size=8))
def test_trajectories_are_found_from_their_origin_on(plan):
    """One after the other, with any rest between them or none, and trajectories of one sample."""
    x_d, v_d = [0.0], [0.0]
    expected: list[Seek] = []
    for length, back, samples, rest in plan:
        row, origin = len(x_d) - 1, x_d[-1]
        way, speed = minimum_jerk(-length if back else length, samples)
        x_d += (origin + way[1:]).tolist() + [origin + way[-1]] * rest
        v_d += speed[1:].tolist() + [0.0] * rest
        expected.append(Seek(row, origin, x_d[-1]))
    assert find_seeks(x_d, v_d, along_trajectory=True) == expected


def test_a_trajectory_that_the_record_cuts_off_is_left_out():
    x_d, v_d = minimum_jerk(10.0, 20)
    assert find_seeks(x_d[:-1], v_d[:-1], along_trajectory=True) == []
    assert find_seeks(x_d, v_d, along_trajectory=True) == [Seek(0, 0.0, 10.0)]


def modes_of(text):
    """Return modes from a text: f, s for seek, t for settle."""
    return np.array([{'f': FOLLOW, 's': SEEK, 't': SETTLE}[letter] for letter in text])


@pytest.mark.parametrize(
    ('text', 'starts', 'rows'),
    [
        ('fffsssttffff', [3], []),
        ('ffffsssttfff', [3], []),
        ('fffsssffff', [3], []),
        ('ffftttffff', [3], []),
        ('fffssttsstff', [3], [7]),
        ('fffssttfftff', [3], [9]),
        ('fffssttffsff', [3], [9]),
        ('ffffffffff', [3], []),
        # Before the first seek nothing counts.
        ('tsftssttff', [4], []),
        # A seek that is interrupted by the next one.
        ('fffsssssssttff', [3, 6], []),
        ('fffsstttssttff', [3, 8], []),
        ('fffsstttttssttff', [3, 8], []),
        ('sstts', [0], [4]),
        ('fts', [], []),
    ],
)
def test_returns_to_an_earlier_mode(text, starts, rows):
    seeks = [Seek(start, 0.0, 1.0) for start in starts]
    assert returns_to_earlier_modes(modes_of(text), seeks) == rows


def responses_of(*pairs):
    """Return responses with lengths [um] and seek times [s]."""
    template = one_response(np.full(10, 10.0))
    return [dataclasses.replace(template, seek=Seek(0, 0.0, length), seek_time=time) for length, time in pairs]


def test_access_times_by_length():
    found = access_times(
        responses_of((1.0, 1e-3), (-1.5, 3e-3), (1.9, 2e-3), (10.0, 4e-3), (-19.0, math.inf), (0.3 - 0.1, 5e-3))
    )
    assert [(row.shortest, row.longest) for row in found] == [
        pytest.approx(x) for x in ((0.2, 0.2), (1, 1.9), (10, 19))
    ]
    assert [(row.count, row.arrived) for row in found] == [(1, 1), (3, 3), (2, 1)]
    assert [row.median for row in found] == [5e-3, 2e-3, math.inf]
    assert [row.worst for row in found] == [5e-3, 3e-3, math.inf]
    assert access_times([]) == []


@given(st.lists(st.tuples(st.floats(1e-3, 1e5), st.floats(1e-5, 1.0) | st.just(math.inf)), min_size=1, max_size=30))
def test_access_times_hold_every_seek_once(pairs):
    found = access_times(responses_of(*pairs))
    assert sum(row.count for row in found) == len(pairs)
    for row in found:
        inside = [time for length, time in pairs if row.shortest <= length <= row.longest]
        assert len(inside) == row.count
        assert row.worst == max(inside)
        assert sum(time <= row.median for time in inside) >= 0.5 * row.count or row.count % 2 == 0
        assert row.longest < row.shortest * 2.5000001
