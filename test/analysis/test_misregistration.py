"""TMR from the record and from the spectrum: (1.1) and (1.2), corrected."""

import numpy as np
import pytest
from scipy import signal

from hdd_servo_ros.analysis.misregistration import misregistration, misregistration_from_spectrum, standard_deviation


def test_standard_deviation_is_unbiased_and_without_the_mean() -> None:
    # (1.2): deviations -1, 0, 1 of 11, 12, 13 over N - 1 = 2
    assert standard_deviation([11.0, 12.0, 13.0]) == pytest.approx(1.0)


def test_sine_has_three_times_its_rms() -> None:
    record = 0.2 * np.sin(2.0 * np.pi * np.arange(10_000) / 100.0)
    assert misregistration(record) == pytest.approx(3.0 * 0.2 / np.sqrt(2.0), rel=1e-4)


def test_record_and_spectrum_agree() -> None:
    record = np.random.default_rng(1).normal(scale=0.05, size=200_000)
    record = signal.lfilter([0.1], [1.0, -0.9], record)
    frequencies, density = signal.welch(record, fs=1.0e4, nperseg=4096)
    assert misregistration_from_spectrum(frequencies, density) == pytest.approx(misregistration(record), rel=0.02)
