"""The cumulative spectrum against known power, and contributions of sources whose variances are known."""

import numpy as np
import pytest

from hdd_servo_ros.analysis.error_spectrum import cumulative_spectrum, error_by_source

T = 1e-4


def test_white_noise_grows_with_the_root_of_frequency():
    noise = np.random.default_rng(1).normal(scale=0.004, size=200_000)
    frequencies, sigma = cumulative_spectrum(noise, T)
    assert frequencies[0] == pytest.approx(5.0)
    assert frequencies[-1] == pytest.approx(5000.0)
    assert sigma[-1] == pytest.approx(0.004, rel=0.01)
    np.testing.assert_allclose(sigma[100:], 0.004 * np.sqrt(frequencies[100:] / 5000.0), rtol=0.03)


def test_a_sine_is_a_step_of_its_rms():
    y = 3.0 + 0.1 * np.sin(2.0 * np.pi * 400.0 * T * np.arange(50_000))
    frequencies, sigma = cumulative_spectrum(y, T)
    assert sigma[frequencies < 380.0].max() < 1e-4
    np.testing.assert_allclose(sigma[frequencies > 420.0], 0.1 / np.sqrt(2.0), rtol=1e-3)


def test_a_short_record_is_rejected():
    with pytest.raises(ValueError, match='at least 4 samples; the signal has 3'):
        cumulative_spectrum([1.0, 2.0, 3.0], T)


def test_independent_sources_get_their_variances_back():
    rng = np.random.default_rng(2)
    parts = {name: rng.normal(scale=scale, size=300_000) for name, scale in (('flutter', 4.0), ('force', 3.0))}
    noise = rng.normal(size=300_000)
    complete = noise + sum(parts.values())
    found = error_by_source(complete, {name: complete - part for name, part in parts.items()})
    assert list(found) == ['flutter', 'force', 'rest']
    assert found['flutter'] == pytest.approx(12.0, rel=0.01)
    assert found['force'] == pytest.approx(9.0, rel=0.01)
    assert found['rest'] == pytest.approx(3.0, rel=0.1)


def test_a_source_that_helps_is_negative():
    ramp = np.arange(1000.0)
    found = error_by_source(ramp, {'a': 2.0 * ramp})
    assert found['a'] == pytest.approx(-np.sqrt(3.0) * 3.0 * np.std(ramp, ddof=1))
    assert found['rest'] == pytest.approx(6.0 * np.std(ramp, ddof=1))
    with pytest.raises(ValueError, match="'rest'"):
        error_by_source(ramp, {'rest': ramp})
