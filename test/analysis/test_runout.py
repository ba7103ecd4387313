"""RPE and NRPE of known runout with known noise, and what is rejected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.analysis.runout import runout_parts

SECTORS = 84


def runout():
    """Return one revolution of harmonics 1 and 3: 30 nm and 5 nm."""
    turns = np.arange(SECTORS) / SECTORS
    return 0.030 * np.sin(2.0 * np.pi * turns) + 0.005 * np.cos(6.0 * np.pi * turns + 1.0)


def test_runout_and_noise_are_separated():
    noise = np.random.default_rng(1).normal(scale=0.004, size=400 * SECTORS)
    parts = runout_parts(np.tile(runout(), 400) + noise, SECTORS)
    assert parts.revolutions == 400
    # 0.2 nm of noise are left in each mean.
    np.testing.assert_allclose(parts.repeatable, runout(), atol=5 * 0.0002)
    assert parts.repeatable_peak_to_peak == pytest.approx(np.ptp(runout()), abs=0.001)
    assert parts.repeatable_three_sigma == pytest.approx(3.0 * np.std(runout(), ddof=1), rel=0.01)
    assert parts.non_repeatable_three_sigma == pytest.approx(0.012, rel=0.01)
    assert parts.non_repeatable_peak_to_peak == pytest.approx(np.ptp(noise), rel=0.05)


def test_two_revolutions_do_not_bias_the_nrpe():
    # Two samples per sector: uncorrected it would be a factor of sqrt(2) too small.
    noise = np.random.default_rng(2).normal(size=2 * 20_000)
    assert runout_parts(noise, 20_000).non_repeatable_three_sigma == pytest.approx(3.0, rel=0.02)


@given(st.integers(2, 30), st.integers(2, 6), st.integers(0, 29))
def test_a_repeating_signal_is_all_rpe_from_the_sector_of_its_first_sample(sectors, revolutions, extra):
    waveform = np.random.default_rng(sectors).normal(size=sectors)
    extra %= sectors
    y = np.tile(waveform, revolutions + 1)[: revolutions * sectors + extra]
    parts = runout_parts(y, sectors)
    np.testing.assert_allclose(parts.repeatable, waveform, atol=1e-12)
    assert parts.non_repeatable_three_sigma == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize(
    ('samples', 'sectors', 'message'),
    [
        (2 * SECTORS - 1, SECTORS, 'two complete revolutions of 84 samples .* has 167 samples'),
        (10, 1, 'sectors = 1'),
    ],
)
def test_too_little_is_rejected(samples, sectors, message):
    with pytest.raises(ValueError, match=message):
        runout_parts(np.zeros(samples), sectors)
