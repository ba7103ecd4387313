"""Shocks: their impulse at every sample time, their shapes, repetition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.parameters import ParameterError, from_mapping

G = 9.80665
MEAN = {'half_sine': 2.0 / np.pi, 'saw_tooth': 0.5, 'trapezoid': 0.9}
"""Mean of each pulse over its duration, for a peak of 1."""


def accelerations(sample_time, count, **values):
    named = {f'shock.{name}': value for name, value in {'enabled': True, **values}.items()}
    return DisturbanceGenerator(from_mapping(DisturbanceParameters, named), sample_time).rows(0, count)[1]


@given(
    st.sampled_from(sorted(MEAN)),
    st.sampled_from([1e-4, 99206e-9, 19841e-9, 1e-3, 7.3e-3]),
    st.floats(1e-5, 1e-2),
    st.floats(0.0, 2e-2),
)
def test_the_velocity_that_a_shock_leaves_is_right_at_every_sample_time(shape, sample_time, duration, time):
    count = int((time + duration) / sample_time) + 3
    found = accelerations(
        sample_time, count, shape=shape, duration=duration, time=time, linear_amplitude=63.0, rotational_amplitude=-40.0
    )
    velocity = found.sum(axis=0) * sample_time
    assert velocity[1] == pytest.approx(63.0 * G * duration * MEAN[shape], rel=1e-9)
    assert velocity[5] == pytest.approx(-40.0 * duration * MEAN[shape], rel=1e-9)
    assert not found[:, [0, 2, 3, 4]].any()


@pytest.mark.parametrize('shape', sorted(MEAN))
def test_the_shape(shape):
    duration, sample_time = 2e-3, 1e-6
    found = accelerations(sample_time, 3000, shape=shape, duration=duration, time=5e-4, linear_amplitude=1.0 / G)[:, 1]
    s = (np.arange(3000) * 1e-6 + 5e-7 - 5e-4) / duration
    inside = (s > 0.0) & (s < 1.0)
    expected = {
        'half_sine': np.sin(np.pi * s),
        'saw_tooth': s,
        'trapezoid': np.minimum(1.0, np.minimum(s, 1.0 - s) / 0.1),
    }[shape]
    assert found == pytest.approx(np.where(inside, expected, 0.0), abs=1e-6)


@given(
    st.sampled_from(sorted(MEAN)),
    st.sampled_from([1e-4, 3.7e-3]),
    st.floats(1e-4, 2e-3),
    st.floats(1.0, 5.0),
    st.integers(1, 20),
)
def test_repeated_shocks_have_the_impulse_of_each(shape, sample_time, duration, ratio, pulses):
    period = ratio * duration
    count = int(np.floor((1e-3 + (pulses - 1) * period + duration) / sample_time)) + 1
    found = accelerations(
        sample_time, count, shape=shape, duration=duration, time=1e-3, period=period, linear_amplitude=1.0 / G
    )[:, 1]
    # The last sample may hold further pulses, and the beginning of one.
    end = count * sample_time - 1e-3
    whole = int(end / period)
    ticks = round((end - whole * period) / 1e-7)
    begun = accelerations(1e-7, ticks, shape=shape, duration=duration, time=0.0, linear_amplitude=1.0 / G)[:, 1]
    assert whole >= pulses - 1
    expected = whole * duration * MEAN[shape] + begun.sum() * 1e-7
    assert found.sum() * sample_time == pytest.approx(expected, rel=1e-9, abs=1e-7)


def test_a_single_shock_is_not_repeated():
    found = accelerations(1e-4, 100_000, time=0.1)
    assert np.flatnonzero(found[:, 1]).tolist() == list(range(1000, 1020))


def test_pulses_that_overlap_are_rejected():
    with pytest.raises(
        ParameterError, match=r'shock\.period: 0\.001; expected 0, or at least duration, which is 0\.002'
    ):
        from_mapping(DisturbanceParameters, {'shock.period': 1e-3})
