"""The period of a reference from its samples, against the frequency they were made with."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from hdd_servo_ros.analysis.period import repeat, sine_period

T = 1e-4
TIME = T * np.arange(5000)


@settings(max_examples=60)
@given(st.floats(0.5, 4000.0), st.floats(0.0, 1.0), st.floats(-100.0, 100.0), st.floats(1e-6, 1e3))
def test_the_period_of_a_sine(frequency, phase, offset, amplitude):
    """Any phase, an offset far larger than the amplitude but where rounding hides the sine, and parts of a period."""
    angle = 2.0 * np.pi * (frequency * TIME + phase)
    x = amplitude * (np.sin(angle) + offset)
    a = -amplitude * (2.0 * np.pi * frequency) ** 2 * np.sin(angle)
    assert sine_period(x, a) == pytest.approx(1.0 / frequency, rel=1e-6)


@pytest.mark.parametrize(
    'x', [np.zeros(50), np.ones(50), TIME, signal.chirp(TIME, 10.0, 0.5, 100.0), signal.square(2e3 * TIME)]
)
def test_what_is_no_sine(x):
    assert sine_period(x, np.gradient(np.gradient(x))) is None


def test_an_acceleration_that_nobody_filled_in_is_no_sine():
    assert sine_period(np.sin(100.0 * TIME), np.zeros_like(TIME)) is None


@pytest.mark.parametrize(
    ('x', 'samples'),
    [
        (np.sin(2.0 * np.pi * 100.0 * TIME), 100),
        (np.sin(2.0 * np.pi * 150.0 * TIME) + 3.0, 200),  # three periods
        (np.sin(2.0 * np.pi * 150.0 * TIME) + 0.5 * np.sin(2.0 * np.pi * 200.0 * TIME + 1.0), 200),
        (1e-6 * signal.square(2.0 * np.pi * 50.0 * (TIME + 0.3 * T)), 200),
        (signal.sawtooth(2.0 * np.pi * 4.0 * (TIME + 0.5 * T)), 2500),
        (np.sin(2.0 * np.pi * 3.0 * TIME), None),  # one and a half periods
        (signal.chirp(TIME, 10.0, 0.5, 100.0), None),
        (TIME, None),
        (np.full(5000, 2.0), None),
        (np.heaviside(TIME - 0.2, 1.0), None),
        (np.random.default_rng(0).normal(size=5000), None),
        (np.ones(1), None),
    ],
)
def test_after_how_many_samples_a_reference_repeats(x, samples):
    assert repeat(x) == samples
