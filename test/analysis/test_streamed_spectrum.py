"""Spectra of a signal that comes in pieces, against SciPy on the whole signal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

from hdd_servo_ros.analysis.metrics import power_spectral_density
from hdd_servo_ros.analysis.misregistration import misregistration_from_spectrum
from hdd_servo_ros.analysis.streamed_spectrum import StreamedDensity, StreamedSpectrum

from .cut import pieces, signals_in_pieces

T = 1e-4


@given(given_signal=signals_in_pieces(least=4), segment=st.integers(4, 80))
def test_the_segments_are_those_of_the_whole_signal(given_signal, segment):
    values, cuts = given_signal
    found = StreamedSpectrum(len(values), segment, lambda part, length: power_spectral_density(part, T, length))
    for piece in pieces(values, cuts):
        found.add(piece)
    frequencies, power = found.result()
    expected = welch(values, fs=1.0 / T, nperseg=min(segment, len(values)), detrend='constant')
    np.testing.assert_array_equal(frequencies, expected[0])
    np.testing.assert_allclose(power, expected[1], rtol=1e-6, atol=1e-18)


@given(given_signal=signals_in_pieces(least=3))
def test_misregistration_without_a_periodogram_is_that_of_the_periodogram(given_signal):
    values, cuts = given_signal
    found = StreamedDensity(len(values))
    for piece in pieces(values, cuts):
        found.add(piece)
    expected = misregistration_from_spectrum(*power_spectral_density(values, T))
    assert found.misregistration(values.mean(), values.var()) == pytest.approx(expected, rel=1e-8)
