"""The density of the vibrometer's noise against the spectrum of what the block itself adds."""

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.sampled_sensor import noise_densities
from hdd_servo_ros.bench.ldv import Ldv, LdvParameters

T = 1e-4


@pytest.mark.parametrize(
    'sensor',
    [
        LdvParameters(),
        LdvParameters(noise_bandwidth=800.0),
        LdvParameters(noise_measure='density', noise_bandwidth=2000.0),
        LdvParameters(noise=False, adc_bits=10),
    ],
)
def test_the_noise_density_is_that_of_the_block(sensor):
    block = Ldv(sensor, T)
    ticks = np.arange(60_000)
    # At random, so that the errors of the converter are independent.
    motion = np.random.default_rng(3).uniform(-30.0, 30.0, (2, len(ticks))) * np.array([[1.0], [300.0]])
    read = np.array([block.step(int(tick), *motion[:, tick]) for tick in ticks]).T
    noise = read * [[sensor.displacement_scale], [sensor.velocity_scale]] - motion
    frequencies, measured = signal.welch(noise, 1.0 / T, nperseg=512)
    expected = noise_densities(sensor, T, frequencies)
    bands = slice(8, 248)
    for found, density in zip(measured, expected.T, strict=True):
        assert (found[bands] / density[bands]).mean() == pytest.approx(1.0, abs=0.05)
        # Within 1 dB in each eighth of the band.
        octants = (found[bands] / density[bands]).reshape(8, -1).mean(axis=1)
        np.testing.assert_allclose(octants, 1.0, atol=0.2)
