"""Sums and extremes in pieces, against numpy."""

import math

import numpy as np
import pytest

from hdd_servo_ros.numerics.moments import Moments, mark_changes


@pytest.mark.parametrize('origin', [None, 0.0, 1e6])
def test_pieces_give_the_moments_of_the_complete_signal(origin):
    values = 1e6 + np.random.default_rng(1).normal(size=(1000, 3))[:, 1]
    moments = Moments(origin)
    for part in np.split(values, (1, 1, 400)):
        moments.add(part)
    assert moments.count == 1000
    if origin != 0.0:  # the squares of a large mean leave nothing of the variance
        assert moments.rms_about() == pytest.approx(values.std(), rel=1e-9)
        assert moments.rms_about(1e6) == pytest.approx(np.sqrt(np.mean((values - 1e6) ** 2)), rel=1e-9)
    assert moments.rms_about(0.0) == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-12)
    assert moments.span == values.max() - values.min()
    assert moments.largest == values.max()
    moments.add(np.array([-2e6]))
    assert moments.largest == 2e6


def test_a_constant_signal_has_no_deviation():
    moments = Moments()
    moments.add(np.full(77, 0.1))
    assert moments.rms_about() == 0.0
    assert moments.span == 0.0


@pytest.mark.parametrize('value', [math.nan, math.inf, 1e200])
def test_non_finite_values_are_detected(value):
    moments = Moments(0.0)
    moments.add(np.array([1.0, value, 1.0]))
    assert not math.isfinite(moments.rms_about(0.0))


def test_changes_of_columns():
    rows = np.ones((50, 4))
    rows[7, 1], rows[49, 2] = 2.0, np.nan
    changed = np.array([False, False, False, True])
    mark_changes(rows, np.ones(4), changed)
    assert changed.tolist() == [False, True, True, True]


def test_nothing():
    moments = Moments()
    moments.add(np.empty(0))
    assert (moments.span, moments.largest, moments.count) == (0.0, 0.0, 0)
    with pytest.raises(ValueError, match='needs at least one sample'):
        moments.rms_about()
