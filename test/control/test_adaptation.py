"""The exact discrete adaptation law against an ODE solver and in its limits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdd_servo_ros.control.adaptation import decay_and_step


@pytest.mark.parametrize(('gain', 'leakage'), [(2.0, 0.5), (3e-15, 1.6e13), (50.0, 400.0), (1.0, 1e-6)])
def test_follows_the_differential_equation(gain, leakage):
    sample_time, drive = 1e-3, 1.7
    a, b = decay_and_step(gain, leakage, sample_time)
    theta = 0.3 / leakage
    solution = solve_ivp(
        lambda _, y: gain * (drive - leakage * y), (0.0, sample_time), [theta], rtol=1e-12, atol=1e-300, method='LSODA'
    )
    assert a * theta + b * drive == pytest.approx(solution.y[0, -1], rel=1e-9)


def test_without_leakage_it_is_an_integrator():
    a, b = decay_and_step(3.0, 0.0, 1e-4)
    assert a == 1.0
    assert b == pytest.approx(3e-4, rel=1e-15)


def test_the_series_meets_the_closed_form():
    """Compare both sides of the branch at gain leakage T = 1e-3 with expm1."""
    for x in (1e-12, 1e-6, 0.999e-3, 1.001e-3, 0.1):
        _, b = decay_and_step(x, 1.0, 1.0)
        assert b == pytest.approx(-math.expm1(-x), rel=3e-13)


@given(st.floats(0.0, 1e30), st.floats(0.0, 1e30), st.floats(1e-7, 1.0))
def test_is_stable_for_any_constants(gain, leakage, sample_time):
    a, b = decay_and_step(gain, leakage, sample_time)
    assert 0.0 <= a <= 1.0
    assert b >= 0.0
    # A constant drive of 1 takes the estimate to 1/leakage, without overshoot and never faster than without leakage.
    if leakage > 1e-3:
        assert b <= 1.0 / leakage * (1.0 + 1e-12)
    assert b <= gain * sample_time * (1.0 + 1e-9)
