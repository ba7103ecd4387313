"""The elementary functions against extended precision, in units of the last place."""

import decimal
import math
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.numerics.elementary import exp, log, sine_cosine_of_turns

PI = decimal.Decimal('3.14159265358979323846264338327950288419716939937510582097494459')


def ulps(value, exact):
    """Distance of a float from an exact decimal, in units of the last place of the exact value."""
    if exact == 0:
        return 0.0 if value == 0.0 else math.inf
    return abs(float((decimal.Decimal(value) - exact) / decimal.Decimal(math.ulp(float(exact)))))


def exact_sine(turns):
    """sin(2 pi turns) by its series, 50 digits, after exact reduction."""
    with decimal.localcontext() as context:
        context.prec = 60
        x = decimal.Decimal(turns) % 1 * 2 * PI
        term, total, n = x, x, 1
        while abs(term) > decimal.Decimal(10) ** -55:
            term = -term * x * x / ((n + 1) * (n + 2))
            total += term
            n += 2
        return +total


@given(st.floats(-707.9, 709.7))
def test_exp_is_within_one_ulp(x):
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(exp(x), decimal.Decimal(x).exp()) <= 1.0


@given(st.floats(-1e-3, 1e-3))
def test_exp_is_within_one_ulp_near_zero(x):
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(exp(x), decimal.Decimal(x).exp()) <= 1.0


@pytest.mark.parametrize(
    ('x', 'value'),
    [(0.0, 1.0), (-0.0, 1.0), (-708.1, 0.0), (-math.inf, 0.0), (709.79, math.inf), (math.inf, math.inf)],
)
def test_exp_at_its_ends(x, value):
    assert exp(x) == value


@given(st.floats(709.43, 709.78))
def test_exp_is_within_one_ulp_where_the_power_of_two_overflows(x):
    """In this range 2**k with k = 1024 overflows."""
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(exp(x), decimal.Decimal(x).exp()) <= 1.0


def test_exp_of_nan():
    assert math.isnan(exp(math.nan))


@given(st.floats(1e-300, 1e300))
def test_log_is_within_one_ulp(x):
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(log(x), decimal.Decimal(x).ln()) <= 1.0


@pytest.mark.parametrize('x', [math.nan, math.inf])
def test_log_of_a_non_finite_number_is_nan(x):
    assert math.isnan(log(x))


@given(st.integers(-1022, 1023))
def test_log_of_a_power_of_two(n):
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(log(2.0**n), decimal.Decimal(2.0**n).ln()) <= 1.0


@given(st.floats(0.9, 1.1))
def test_log_is_within_one_ulp_near_one(x):
    with decimal.localcontext() as context:
        context.prec = 40
        assert ulps(log(x), decimal.Decimal(x).ln()) <= 1.0


@given(st.floats(-1e6, 1e6))
def test_sine_and_cosine_of_turns(turns):
    sine, cosine = sine_cosine_of_turns(turns)
    # 2 pi itself is rounded once: the bound is relative to 1, not to a sine near zero.
    assert abs(decimal.Decimal(sine) - exact_sine(turns)) <= decimal.Decimal('2.3e-16')
    with decimal.localcontext() as context:
        context.prec = 60
        shifted = decimal.Decimal(turns) + decimal.Decimal('0.25')
    assert abs(decimal.Decimal(cosine) - exact_sine(shifted)) <= decimal.Decimal('2.3e-16')


@pytest.mark.parametrize('whole', [0.0, 1.0, -3.0, 2.0**40])
def test_quarter_turns_are_exact(whole):
    expected = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]
    assert [sine_cosine_of_turns(whole + quarter / 4.0) for quarter in range(4)] == expected


def test_agrees_with_the_interpreted_code():
    """Compiled and interpreted results are bit-identical."""
    for x in np.random.default_rng(5).uniform(-700.0, 700.0, 200):
        x = float(x)
        assert exp(x) == cast(Any, exp).py_func(x)
        assert log(abs(x)) == cast(Any, log).py_func(abs(x))
        assert sine_cosine_of_turns(x) == cast(Any, sine_cosine_of_turns).py_func(x)
