"""The servo sensor against what is computed here from its definition, each error by itself."""

import math
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.bench.servo_sensor import MissingSectorParameters, ServoSensor, ServoSensorParameters
from hdd_servo_ros.parameters import ParameterError

PITCH = 0.254
PERFECT: dict[str, Any] = {'track_pitch': PITCH, 'noise': 0.0, 'bits': 0}


def sensor(**changes):
    return ServoSensor(ServoSensorParameters(**{**PERFECT, **changes}), 1e-4)


def decoded(block, heads, centers=None):
    """Error, position and sector at ticks 0, 1, ..., shape (n, 3)."""
    centers = np.zeros(len(heads)) if centers is None else centers
    return np.array([block.step(tick, head, centers[tick]) for tick, head in enumerate(heads)])


def test_position_and_fraction_of_a_track():
    heads = np.random.default_rng(1).uniform(-30.0, 30.0, 1000)
    centers = np.random.default_rng(2).uniform(-0.3, 0.3, 1000)
    error, position, _ = decoded(sensor(), heads, centers).T
    np.testing.assert_allclose(position, heads - centers, atol=1e-12)
    # The remainder of IEEE 754 is the distance from the nearest multiple.
    np.testing.assert_allclose(error, [math.remainder(x, PITCH) for x in heads - centers], atol=1e-12)


@pytest.mark.parametrize('track', [-40, 0, 3])
def test_with_the_reference_on_a_track_the_error_is_head_minus_track_center(track):
    center = track * PITCH
    heads = center + np.linspace(-0.4, 0.4, 9) * PITCH
    runout = np.full(9, 0.05 * PITCH)
    error, position, _ = decoded(sensor(), heads, runout).T
    np.testing.assert_allclose(position - center, heads - center - runout, atol=1e-12)
    np.testing.assert_allclose(error, position - center, atol=1e-12)


@pytest.mark.parametrize('bits', [4, 10])
def test_the_fraction_is_rounded_to_codes_of_which_the_track_center_is_one(bits):
    heads = np.random.default_rng(3).uniform(-0.5, 0.5, 500) * PITCH
    error = decoded(sensor(bits=bits), heads)[:, 0]
    codes = error / (PITCH / 2**bits)
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)
    assert np.abs(error - heads).max() <= 0.5 * PITCH / 2**bits + 1e-12
    assert sensor(bits=bits).step(0, 0.0)[0] == 0.0


def test_the_nonlinearity_is_zero_at_the_track_center_and_half_way_between_two():
    heads = np.linspace(-0.5, 0.4999, 1001) * PITCH
    error = decoded(sensor(nonlinearity=5.0), heads)[:, 0]
    wanted = heads + 0.05 * PITCH * np.sin(2.0 * np.pi * heads / PITCH)
    np.testing.assert_allclose(error, wanted, atol=1e-12)
    assert (np.diff(error) > 0.0).all()


def test_noise_has_its_rms_value_and_depends_on_seed_and_tick_alone():
    noise = decoded(sensor(noise=0.0038, seed=9), np.zeros(20_000))[:, 0]
    assert noise.std() == pytest.approx(0.0038, rel=0.02)
    spectrum = np.abs(np.fft.rfft(noise)[1:]) ** 2
    assert spectrum[:2500].sum() == pytest.approx(spectrum[-2500:].sum(), rel=0.1)
    assert sensor(noise=0.0038, seed=9).step(123, 0.0)[0] == noise[123]
    other = decoded(sensor(noise=0.0038, seed=10), np.zeros(20_000))[:, 0]
    assert abs(np.corrcoef(noise, other)[0, 1]) < 0.03


@pytest.mark.parametrize('bits', [0, 8])
def test_the_fraction_is_clipped_at_half_a_track_with_a_count_and_one_warning(bits):
    block = sensor(noise=0.2 * PITCH, bits=bits)
    error = decoded(block, np.full(2000, 0.45 * PITCH))[:, 0]
    assert error.max() == pytest.approx(0.5 * PITCH, abs=1e-15)
    free = decoded(sensor(noise=0.2 * PITCH, track_pitch=100.0 * PITCH), np.full(2000, 0.45 * PITCH))[:, 0]
    beyond = np.abs(free) > 0.5 * PITCH
    assert block.saturated_samples == {'fraction': int(beyond.sum())}
    (text,) = block.saturation_warnings().values()
    assert f'half the pitch, 0.127 um, at tick {np.flatnonzero(beyond)[0]};' in text
    assert sensor().saturation_warnings() == {}


def test_sectors_are_numbered_within_the_revolution():
    assert decoded(sensor(sectors=84), np.zeros(200))[:, 2].tolist() == [tick % 84 for tick in range(200)]
    assert decoded(sensor(), np.zeros(200))[:, 2].tolist() == list(range(200))


def test_of_a_missing_sector_the_last_values_are_held():
    heads = 1e-3 * np.arange(40)
    block = sensor(sectors=10, missing=MissingSectorParameters(sectors=(3, 4)))
    error, position, number = decoded(block, heads).T
    wanted = heads.copy()
    for revolution in range(4):
        wanted[10 * revolution + 3 : 10 * revolution + 5] = heads[10 * revolution + 2]
    np.testing.assert_allclose(position, wanted, atol=1e-15)
    np.testing.assert_allclose(error, wanted, atol=1e-15)
    assert number.tolist() == [tick % 10 for tick in range(40)]
    assert block.missing_sectors == 8


def test_missing_sectors_by_seed():
    heads = np.arange(20_000) * 1e-6
    block = sensor(missing=MissingSectorParameters(probability=0.1))
    position = decoded(block, heads)[:, 1]
    held = np.flatnonzero(np.diff(position) == 0.0) + 1
    assert len(held) == block.missing_sectors
    assert len(held) / 20_000 == pytest.approx(0.1, rel=0.05)
    # Independent of each other: of the missing ones a tenth is followed by another.
    assert np.mean(np.diff(held) == 1) == pytest.approx(0.1, rel=0.2)


def test_the_first_sector_is_never_missing():
    block = sensor(sectors=5, missing=MissingSectorParameters(sectors=(0,), probability=1.0))
    assert decoded(block, np.array([0.03, 0.04, 0.05]))[:, 1].tolist() == [0.03] * 3


def test_non_finite_values_pass():
    assert math.isnan(sensor(noise=0.01, bits=8).step(5, math.nan)[1])
    assert math.isinf(sensor().step(5, math.inf)[1])


def test_other_parameters_go_on_from_the_held_values():
    block = sensor(sectors=5)
    block.step(0, 0.02)
    block.update(ServoSensorParameters(**PERFECT, sectors=5, missing=MissingSectorParameters(sectors=(1,))))
    assert block.step(1, 0.05)[1] == 0.02


@pytest.mark.parametrize(
    ('changes', 'error'),
    [
        ({'track_pitch': 0.0}, r'track_pitch: 0\.0; expected .*above 0'),
        ({'nonlinearity': 16.0}, r'nonlinearity: 16\.0;'),
        ({'missing': {'sectors': (1,)}}, r'missing\.sectors: \(1,\); expected an empty list, because sectors = 0'),
        (
            {'sectors': 4, 'missing': {'sectors': (1, 4)}},
            r'missing\.sectors: \(1, 4\); expected numbers below sectors, .* 4',
        ),
        ({'sectors': 2, 'missing': {'sectors': (0, 1)}}, r'missing\.sectors: \(0, 1\); expected fewer than all 2'),
    ],
)
def test_rejected(changes, error):
    if 'missing' in changes:
        changes = {**changes, 'missing': MissingSectorParameters(**changes['missing'])}
    with pytest.raises(ParameterError, match=error):
        ServoSensorParameters(**changes)
