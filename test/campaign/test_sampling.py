"""Draws follow their distribution, plans fill the space, ranges end where they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from hdd_servo_ros.campaign.sampling import PLANS, Distribution, scaled, shares, values_of_range
from hdd_servo_ros.parameters.files import ArgumentError

SHARES = (np.arange(1000) + 0.5) / 1000


@pytest.mark.parametrize(
    ('distribution', 'reference'),
    [
        (Distribution('uniform', -1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (Distribution('normal', 2.0, 0.5), stats.norm(2.0, 0.5)),
        (Distribution('log_uniform', 1e-3, 10.0), stats.loguniform(1e-3, 10.0)),
    ],
)
def test_draws_are_the_quantiles_of_the_distribution(distribution, reference):
    np.testing.assert_allclose(distribution.at(SHARES), reference.ppf(SHARES), rtol=2e-11)
    drawn = distribution.at(shares('random', 3, 2000, 1)[:, 0])
    assert stats.kstest(drawn, reference.cdf).pvalue > 0.01


def test_the_ends_of_the_unit_interval_are_finite():
    assert np.isfinite(Distribution('normal', 0.0, 1.0).at(np.array([0.0, 1.0]))).all()


@pytest.mark.parametrize('plan', PLANS)
def test_a_plan_depends_on_its_seed_alone(plan):
    points = shares(plan, 5, 16, 3)
    assert points.shape == (16, 3)
    np.testing.assert_array_equal(points, shares(plan, 5, 16, 3))
    assert (points != shares(plan, 6, 16, 3)).all()


@pytest.mark.parametrize('runs', [16, 13])
def test_a_latin_hypercube_has_one_point_per_interval(runs):
    points = shares('latin_hypercube', 1, runs, 4)
    for column in points.T:
        assert sorted(np.floor(runs * column).astype(int)) == list(range(runs))


def test_a_sobol_sequence_is_balanced():
    points = shares('sobol', 1, 64, 2)
    counts, _ = np.histogramdd(points, bins=8, range=[(0.0, 1.0), (0.0, 1.0)])
    assert (counts == 1).all()
    np.testing.assert_array_equal(shares('sobol', 1, 40, 2), points[:40])


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 40))
def test_ranges_are_those_of_numpy(first, last, count):
    np.testing.assert_allclose(
        values_of_range('linspace', [first, last, count], 'x'), np.linspace(first, last, count), rtol=1e-10
    )
    found = values_of_range('logspace', [first, last, count], 'x')
    assert (found[0], found[-1]) == (first, last)
    np.testing.assert_allclose(found, np.geomspace(first, last, count), rtol=1e-10)


def test_a_list_is_scaled_element_by_element():
    assert scaled((1.0, 2.0), 1.5, 'x') == (1.5, 3.0)
    with pytest.raises(ArgumentError, match="x: times_base is invalid: the base value 'text' is not a number"):
        scaled('text', 1.5, 'x')


@pytest.mark.parametrize(
    ('kind', 'first', 'second', 'message'),
    [
        ('uniform', 2.0, 1.0, 'expected the first number below the second'),
        ('normal', 2.0, 0.0, 'expected a standard deviation above 0'),
        ('log_uniform', 0.0, 1.0, 'expected numbers above 0'),
        ('uniform', 0.0, np.inf, 'expected finite numbers'),
        ('cauchy', 0.0, 1.0, 'expected one of uniform, normal, log_uniform'),
    ],
)
def test_a_wrong_distribution_is_rejected(kind, first, second, message):
    with pytest.raises(ArgumentError, match=message):
        Distribution(kind, first, second)
