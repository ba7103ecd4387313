"""Bounds on e from bounds on r, against integrated impulse responses and simulations of the filter."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import impulse, lsim

from hdd_servo_ros.stability.error_filter import ErrorFilter

CASES = [(3.0, 0.0), (3.0, 0.1), (3.0, 2.0), (3.0, 2.25), (3.0, 2.2500001), (3.0, 5.0), (0.4, 30.0), (2300.0, 4.6e5)]


@pytest.mark.parametrize(('lambda_', 'lambda_i'), CASES)
def test_the_norms_are_the_integrals_of_the_impulse_responses(lambda_, lambda_i):
    slowest = min(abs(np.roots([1.0, lambda_, lambda_i] if lambda_i > 0.0 else [1.0, lambda_]).real))

    def rhs(t, y):
        h, g = y[:2]
        # s G = 1 - (lambda s + lambda_i)/(s^2 + lambda s + lambda_i): an impulse, and the rest.
        rest = lambda_ * g + lambda_i * h
        return [g, -rest, abs(g), abs(rest)]

    solved = solve_ivp(rhs, (0.0, 30.0 / slowest), [0.0, 1.0, 0.0, 0.0], method='LSODA', rtol=1e-9, atol=1e-12)
    found = ErrorFilter(lambda_, lambda_i)
    assert found.norm == pytest.approx(solved.y[2, -1], rel=1e-5)
    assert found.rate_norm == pytest.approx(1.0 + solved.y[3, -1], rel=1e-5)


def test_without_lambda_nothing_is_bounded():
    for lambda_i in (0.0, 4.0):
        found = ErrorFilter(0.0, lambda_i)
        assert not found.is_stable
        assert (found.norm, found.rate_norm) == (math.inf, math.inf)
        assert np.isinf(found.error_over(np.arange(3.0), np.ones(3), 0.0, 0.0)).all()


@pytest.mark.parametrize(('lambda_', 'lambda_i'), CASES)
def test_the_worst_r_reaches_the_norm(lambda_, lambda_i):
    """With r = sgn g(t1 - t) e(t1) is the integral of |g| up to t1, which the bound meets."""
    found = ErrorFilter(lambda_, lambda_i)
    slowest = min(abs(np.roots([1.0, lambda_, lambda_i] if lambda_i > 0.0 else [1.0, lambda_]).real))
    t = np.linspace(0.0, 12.0 / slowest, 20_001)
    _, g = impulse(([1.0, 0.0], [1.0, lambda_, lambda_i]), T=t)
    r = np.where(g[::-1] >= 0.0, 1.0, -1.0)
    _, e, _ = lsim(([1.0, 0.0], [1.0, lambda_, lambda_i]), r, t)
    bound = found.error_over(t, np.ones(len(t)), 0.0, 0.0)
    assert bound[-1] == pytest.approx(e[-1], rel=1e-2)
    assert bound[-1] == pytest.approx(found.norm, rel=1e-3)
    assert (np.abs(e) <= bound + 1e-2 * found.norm).all()


@given(
    lambda_=st.floats(0.5, 20.0),
    lambda_i=st.one_of(st.just(0.0), st.floats(1e-3, 100.0)),
    error=st.floats(-2.0, 2.0),
    integral=st.floats(-1.0, 1.0),
    frequency=st.floats(0.1, 20.0),
    decay=st.floats(0.0, 3.0),
)
@settings(max_examples=25, deadline=None)
def test_the_filter_keeps_its_bounds(lambda_, lambda_i, error, integral, frequency, decay):
    found = ErrorFilter(lambda_, lambda_i)
    time = np.linspace(0.0, 3.0, 601)
    limit = 0.5 + 2.0 * np.exp(-decay * time)

    def rhs(t, y):
        r = (0.5 + 2.0 * math.exp(-decay * t)) * math.sin(frequency * t)
        return [r - lambda_ * y[0] - lambda_i * y[1], y[0]]

    start = integral if lambda_i > 0.0 else 0.0
    solved = solve_ivp(rhs, (0.0, 3.0), [error, start], t_eval=time, rtol=1e-7, atol=1e-9)
    e, total = solved.y
    rate = limit * np.sin(frequency * time) - lambda_ * e - lambda_i * total
    size = found.initial_size(error, start)
    assert (np.abs(e) <= found.error_over(time, limit, error, start) + 1e-5).all()
    assert (np.abs(e) <= size + found.norm * 2.5 + 1e-5).all()
    assert (np.abs(rate) <= found.largest_rate(size) + found.rate_norm * 2.5 + 1e-5).all()
