"""Time off track of a sine and of stretches, shocks found in an acceleration, and the response of a known system."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.analysis.off_track import off_track, shock_responses, shock_times

T = 1e-4


@given(st.floats(0.05, 0.95))
def test_a_sine_is_beyond_a_limit_for_a_known_fraction(limit):
    phase = 2.0 * np.pi * (np.arange(100_000) + 0.5) / 10_000
    found = off_track(np.sin(phase), limit, T)
    # Between asin(limit) and pi minus it, twice per period.
    fraction = 1.0 - 2.0 * np.arcsin(limit) / np.pi
    assert found.fraction == pytest.approx(fraction, abs=5e-4)
    assert found.longest == pytest.approx(0.5 * fraction * 10_000 * T, abs=2 * T)


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_the_longest_stretch_is_that_of_a_text_search(flags):
    found = off_track(np.where(flags, 2.0, 0.5), 1.0, T)
    text = ''.join('x' if flag else ' ' for flag in flags)
    assert found.longest == pytest.approx(T * max(map(len, text.split()), default=0))
    assert found.fraction == pytest.approx(sum(flags) / len(flags))


def test_no_sample_is_rejected():
    with pytest.raises(ValueError, match='no sample'):
        off_track([], 1.0, T)


def half_sine(peak, duration, start, samples):
    """Return a half-sine of acceleration, and time."""
    t = T * np.arange(samples)
    inside = (t >= start) & (t <= start + duration)
    return t, np.where(inside, peak * np.sin(np.pi * (t - start) / duration), 0.0)


def test_shocks_are_found_at_their_begin():
    _, first = half_sine(618.0, 2e-3, 0.1, 5000)
    _, second = half_sine(-618.0, 2e-3, 0.3, 5000)
    vibration = 9.0 * np.sin(0.3 * np.arange(5000))
    # A half-sine passes 50 m/s^2 after 0.05 ms.
    assert shock_times(first + second + vibration, T) == pytest.approx([0.1, 0.3], abs=1.1e-4)
    assert len(shock_times(vibration, T)) == 0


def test_the_half_sine_response_of_an_oscillator():
    """Undamped at w, a half-sine of length pi/w: x = A (sin wt - wt cos wt)/2 during it, and after it A pi/2 cos."""
    w, amplitude = np.pi / 0.02, 0.3
    t, _ = half_sine(1.0, 0.02, 0.05, 3000)
    phase = w * np.clip(t - 0.05, 0.0, None)
    during = 0.5 * amplitude * (np.sin(phase) - phase * np.cos(phase))
    # With the damping of a loop afterward.
    after = 0.5 * np.pi * amplitude * -np.cos(phase) * np.exp(-100.0 * (t - 0.07))
    error = np.where(phase < np.pi, during, after)
    (found,) = shock_responses(t, error, [0.05], band=0.05)
    assert found.peak == pytest.approx(0.5 * np.pi * amplitude, rel=1e-3)
    outside = np.abs(error) > 0.05
    assert found.outside == pytest.approx(T * outside.sum())
    assert found.recovery == pytest.approx(t[outside][-1] + T - 0.05)
    # The envelope enters the band at ln(0.5 pi A/0.05)/100, and the response is outside for the last time before.
    envelope = 0.02 + np.log(0.5 * np.pi * amplitude / 0.05) / 100.0
    assert envelope - 0.02 < found.recovery <= envelope + T


def test_each_shock_counts_until_the_next():
    t = T * np.arange(1000)
    error = np.zeros(1000)
    error[200:210], error[600:] = 0.2, -0.3
    (
        first,
        second,
    ) = shock_responses(t, error, [0.0195, 0.0595], band=0.1)
    assert (first.peak, second.peak) == (0.2, 0.3)
    assert first.recovery == pytest.approx(15 * T)
    assert first.outside == pytest.approx(10 * T)
    assert second.recovery == np.inf
    (calm,) = shock_responses(t[:100], error[:100], [0.001], band=0.1)
    assert (calm.outside, calm.recovery) == (0.0, 0.0)


@pytest.mark.parametrize(
    ('shocks', 'message'), [([0.2], 'at 0.2 s: the record spans 0 to 0.0999'), ([0.05, 0.02], 'ascending')]
)
def test_shocks_outside_the_record_are_rejected(shocks, message):
    with pytest.raises(ValueError, match=message):
        shock_responses(T * np.arange(1000), np.zeros(1000), shocks, band=0.1)
