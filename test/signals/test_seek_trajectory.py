"""Trajectories of a seek: closed forms, SciPy's integrals and linear programs, and bounds over all lengths."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson
from scipy.optimize import linprog

from hdd_servo_ros.numerics.records import record, zeros
from hdd_servo_ros.signals.seek_trajectory import (
    SEEK,
    Bounds,
    cube_root,
    set_trajectory,
    time_optimal_segments,
    trajectory_at,
    trajectory_time,
)

SMOOTH = ('minimum_jerk', 'time_optimal')
BOUNDS = st.builds(
    Bounds,
    st.floats(1e6, 1e9),
    st.one_of(st.just(0.0), st.floats(1e10, 1e14)),
    st.one_of(st.just(0.0), st.floats(1e3, 1e6)),
)


def sampled(trajectory, distance, bounds, samples, origin=0.0):
    """Return times and rows of a seek whose duration is that of its bounds, in this many samples."""
    row = zeros(SEEK)
    seek = record(row, SEEK)
    seek.origin, seek.target = origin, origin + distance
    duration = trajectory_time(trajectory, abs(distance), bounds)
    sample_time = duration / samples
    set_trajectory(seek, trajectory, bounds, samples, sample_time)
    rows = np.array([trajectory_at(seek, sample, sample_time) for sample in range(samples + 1)])
    return np.arange(samples + 1) * sample_time, rows


@given(st.floats(1e-30, 1e30))
def test_cube_root(x):
    assert cube_root(x) == pytest.approx(np.cbrt(x), rel=1e-15)


def test_minimum_jerk_is_the_polynomial_of_degree_5():
    time, rows = sampled('minimum_jerk', -40.0, Bounds(2e8), 1000, origin=7.0)
    duration = time[-1]
    assert duration == pytest.approx(math.sqrt(5.7735 * 40.0 / 2e8), rel=1e-5)
    position = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    for derivative, column in enumerate(rows.T):
        expected = position.deriv(derivative)(time / duration) * -40.0 / duration**derivative
        scale = 40.0 / duration**derivative
        np.testing.assert_allclose(column, expected + (7.0 if derivative == 0 else 0.0), atol=1e-13 * scale, rtol=1e-13)


@pytest.mark.parametrize(
    ('bounds', 'quantity', 'limit'),
    [
        (Bounds(2e8), 2, 2e8),
        (Bounds(1e12, 1e11), 3, 1e11),
        (Bounds(1e12, 0.0, 5e3), 1, 5e3),
    ],
)
def test_minimum_jerk_reaches_the_bound_that_decides(bounds, quantity, limit):
    duration = trajectory_time('minimum_jerk', 10.0, bounds)
    derivative = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6]).deriv(quantity)
    largest = np.abs(derivative(np.linspace(0.0, 1.0, 100_001))).max() * 10.0 / duration**quantity
    assert largest == pytest.approx(limit, rel=1e-8)


def test_time_optimal_without_a_bound_on_jerk_is_bang_bang():
    assert trajectory_time('time_optimal', 50.0, Bounds(4e8)) == pytest.approx(2.0 * math.sqrt(50.0 / 4e8))
    time, rows = sampled('time_optimal', 50.0, Bounds(4e8), 8)
    np.testing.assert_allclose(rows[:, 2], [4e8] * 4 + [-4e8] * 4 + [0.0])
    np.testing.assert_allclose(rows[:, 1], 4e8 * np.minimum(time, time[::-1]), atol=1e-6)
    np.testing.assert_allclose(rows[:5, 0], 2e8 * time[:5] ** 2)


def test_each_part_of_a_bang_bang_trajectory_begins_with_its_first_sample():
    """With a bound on velocity: 3 samples of acceleration, 4 without, 3 of the other sign."""
    bounds = Bounds(1e8, 0.0, 3e4)
    _, rows = sampled('time_optimal', 21.0, bounds, 10)
    np.testing.assert_allclose(rows[:, 2], [1e8] * 3 + [0.0] * 4 + [-1e8] * 3 + [0.0], atol=1e-3)


def test_time_optimal_with_a_bound_on_jerk_alone():
    assert trajectory_time('time_optimal', 3.0, Bounds(1e12, 1e11)) == pytest.approx(4.0 * (3.0 / 2e11) ** (1 / 3))


@pytest.mark.parametrize(
    ('length', 'bounds'),
    [
        (1.0, Bounds(2e8, 1e12)),  # acceleration not reached
        (100.0, Bounds(2e8, 1e12)),  # acceleration reached
        (100.0, Bounds(2e8, 1e12, 5e4)),  # velocity reached, acceleration reached
        (100.0, Bounds(2e8, 1e12, 2e4)),  # velocity reached, acceleration not
        (100.0, Bounds(2e8, 0.0, 5e4)),
    ],
)
def test_no_trajectory_is_faster(length, bounds):
    """
    The longest way from rest to rest in that time is no longer, by a linear program.

    Its acceleration is a polygon over many intervals, so it comes within one part in n^2 of any trajectory with a
    bound on jerk, and 2/n of one without.
    """
    n = 200
    step = trajectory_time('time_optimal', length, bounds) / n
    acceleration, jerk, velocity = bounds
    # In units of the bound on acceleration and of the step; a_0 = a_n = 0 where jerk is bounded.
    trapezoid = np.tri(n + 1, n + 1)
    trapezoid[:, 0] -= 0.5
    trapezoid -= 0.5 * np.eye(n + 1)
    trapezoid[0] = 0.0
    velocity_of = trapezoid
    # The integral of a velocity that is a parabola in each interval.
    each = np.eye(n + 1)
    distance = (velocity_of[:-1] + each[:-1] / 3.0 + each[1:] / 6.0).sum(axis=0)
    inequalities, limits = [], []
    if jerk > 0.0:
        difference = np.diff(each, axis=0)
        inequalities += [difference, -difference]
        limits += [np.full(2 * n, jerk * step / acceleration)]
    if velocity > 0.0:
        inequalities += [velocity_of]
        limits += [np.full(n + 1, velocity / (acceleration * step))]
    ends = (0.0, 0.0) if jerk > 0.0 else (-1.0, 1.0)
    found = linprog(
        -distance,
        A_ub=np.concatenate(inequalities) if inequalities else None,
        b_ub=np.concatenate(limits) if limits else None,
        A_eq=velocity_of[-1:],
        b_eq=[0.0],
        bounds=[ends, *[(-1.0, 1.0)] * (n - 1), ends],
    )
    assert found.success
    longest = -found.fun * acceleration * step * step
    assert longest == pytest.approx(length, rel=2e-3 if jerk > 0.0 else 0.02)


@settings(max_examples=200, deadline=None)
@given(
    trajectory=st.sampled_from(SMOOTH),
    length=st.floats(0.01, 2e4),
    sign=st.sampled_from([-1.0, 1.0]),
    origin=st.floats(-100.0, 100.0),
    bounds=BOUNDS,
    samples=st.integers(1, 400),
)
def test_bounds_hold_and_the_ends_are_at_rest(trajectory, length, sign, origin, bounds, samples):
    time, rows = sampled(trajectory, sign * length, bounds, samples, origin)
    target = origin + sign * length
    np.testing.assert_array_equal(rows[-1], [target, 0.0, 0.0])
    assert (rows[0, 0], rows[0, 1]) == (origin, 0.0)
    if trajectory == 'minimum_jerk' or bounds.jerk > 0.0:
        assert abs(rows[0, 2]) == 0.0
        if bounds.jerk > 0.0:
            largest = np.abs(np.diff(rows[:, 2])).max()
            assert largest <= bounds.jerk * (time[1] - time[0]) * (1.0 + 1e-9) + 1e-9 * bounds.acceleration
    assert np.abs(rows[:, 2]).max() <= bounds.acceleration * (1.0 + 1e-9)
    if bounds.velocity > 0.0:
        assert np.abs(rows[:, 1]).max() <= bounds.velocity * (1.0 + 1e-9)
    # It never turns round.
    assert (sign * np.diff(rows[:, 0]) >= -1e-12 * (length + abs(origin))).all()


@settings(max_examples=50, deadline=None)
@given(trajectory=st.sampled_from(SMOOTH), length=st.floats(0.1, 1e3), bounds=BOUNDS)
def test_derivatives_integrate_to_the_position(trajectory, length, bounds):
    time, rows = sampled(trajectory, length, bounds, 4000)
    velocity = cumulative_simpson(rows[:, 2], x=time, initial=0.0)
    position = cumulative_simpson(rows[:, 1], x=time, initial=0.0)
    step = time[1]
    # Where the acceleration or the jerk is discontinuous, the error is up to the acceleration change of one interval.
    gained = min(bounds.acceleration, bounds.jerk * step) if bounds.jerk > 0.0 else bounds.acceleration
    jump = gained * step if trajectory == 'time_optimal' else 0.0
    np.testing.assert_allclose(velocity, rows[:, 1], atol=2.0 * jump + 1e-9 * rows[:, 1].max())
    np.testing.assert_allclose(position, rows[:, 0], atol=2.0 * jump * step + 1e-9 * length)


@settings(max_examples=50, deadline=None)
@given(length=st.floats(0.01, 1e4), bounds=BOUNDS)
def test_durations_grow_with_the_length_and_shrink_with_the_bounds(length, bounds):
    for trajectory in SMOOTH:
        duration = trajectory_time(trajectory, length, bounds)
        assert trajectory_time(trajectory, 1.01 * length, bounds) > duration
        wider = Bounds(1.1 * bounds.acceleration, 1.1 * bounds.jerk, 1.1 * bounds.velocity)
        assert trajectory_time(trajectory, length, wider) < duration
    assert sum(time_optimal_segments(length, bounds)) <= trajectory_time('minimum_jerk', length, bounds) * (1.0 + 1e-12)


def test_no_way_takes_no_time():
    for trajectory in ('step', *SMOOTH):
        assert trajectory_time(trajectory, 0.0, Bounds(1e8, 1e12, 1e4)) == 0.0
    assert time_optimal_segments(0.0, Bounds(1e8)).duration == 0.0
