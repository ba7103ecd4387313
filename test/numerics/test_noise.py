"""Noise: known values, distribution, and dependence on seed, stream and tick only."""

import math
from typing import Any, cast

import numpy as np
import pytest
from scipy import stats

from hdd_servo_ros.numerics.noise import fill_normal_pairs, normal_pair, normal_quantile, philox4x32

ONES = 0xFFFFFFFF


@pytest.mark.parametrize(
    ('counter', 'key', 'words'),
    [
        # Random123, kat_vectors, philox4x32 10
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((ONES, ONES, ONES, ONES), (ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_known_values(counter, key, words):
    result = philox4x32(*(np.uint64(word) for word in (*counter, *key)))
    assert tuple(int(word) for word in result) == words


def test_normal_quantile_against_scipy():
    p = np.concatenate(
        [np.linspace(1e-6, 1.0 - 1e-6, 4001), 10.0 ** -np.arange(1.0, 17.0), [0.075, 0.925, math.exp(-25.0)]]
    )
    quantiles = np.array([normal_quantile(float(value)) for value in p])
    np.testing.assert_allclose(quantiles, stats.norm.ppf(p), rtol=2e-14, atol=1e-15)


def test_normal_quantile_is_odd():
    for p in (0.5, 0.25, 0.125, 2.0**-20):
        assert normal_quantile(p) == -normal_quantile(1.0 - p)


def pairs(seed, stream, count):
    return np.array([normal_pair(seed, stream, tick) for tick in range(count)])


def test_deviates_are_standard_normal_and_white():
    noise = pairs(1, 0, 20000)
    for column in noise.T:
        assert stats.kstest(column, 'norm').pvalue > 1e-3
        lagged = np.array([np.mean(column[lag:] * column[:-lag]) for lag in (1, 2, 3, 10)])
        assert np.all(np.abs(lagged) < 4.0 / math.sqrt(len(column)))
    assert abs(np.mean(noise[:, 0] * noise[:, 1])) < 4.0 / math.sqrt(len(noise))


def test_seeds_and_streams_are_unrelated():
    base = pairs(1, 0, 4000)[:, 0]
    for seed, stream in ((2, 0), (1, 1), (2**32 + 1, 0)):
        other = pairs(seed, stream, 4000)[:, 0]
        assert abs(np.mean(base * other)) < 4.0 / math.sqrt(len(base))


def test_a_tick_far_away_needs_no_history():
    late = 2**40 + 5
    assert normal_pair(7, 0, late) == normal_pair(7, 0, late)
    assert normal_pair(7, 0, late) != normal_pair(7, 0, 5)


def test_agrees_with_the_interpreted_code():
    for p in (1e-12, 0.01, 0.3, 0.5, 0.97):
        assert normal_quantile(p) == cast(Any, normal_quantile).py_func(p)


@pytest.mark.parametrize('first_tick', [0, 5, 2**40])
def test_a_chunk_of_ticks_has_the_pairs_of_its_ticks(first_tick):
    """Bit-identical, including the tails, which a chunk of 5000 pairs reaches on both sides."""
    found = np.empty(2 * 5000)
    fill_normal_pairs(7, 3, first_tick, found)
    expected = np.array([normal_pair(7, 3, first_tick + row) for row in range(5000)])
    assert found.tobytes() == expected.tobytes()
    assert found.min() < -3.0
    assert found.max() > 3.0


def test_a_chunk_without_a_tick_has_no_pair():
    fill_normal_pairs(7, 3, 0, np.empty(0))
