"""What repeats in a signal that comes in pieces, against the same from the whole signal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.analysis.metrics import repeatable_parts
from hdd_servo_ros.analysis.runout import runout_parts
from hdd_servo_ros.analysis.streamed_periods import StreamedPeriods

from .cut import pieces, signals_in_pieces


@given(given_signal=signals_in_pieces(least=8), period=st.integers(2, 60))
def test_the_parts_are_those_of_the_whole_signal(given_signal, period):
    values, cuts = given_signal
    if len(values) < 2 * period:
        with pytest.raises(ValueError, match='two periods'):
            StreamedPeriods(len(values), period)
        return
    sums = StreamedPeriods(len(values), period)
    for piece in pieces(values, cuts):
        sums.add(piece)
    whole, parts = repeatable_parts(values, float(period)), runout_parts(values, period)
    np.testing.assert_allclose(sums.waveform, whole.waveform, rtol=1e-12, atol=1e-10)
    assert sums.cycles == whole.cycles
    assert sums.rest_rms == pytest.approx(whole.non_repeatable_rms, rel=1e-6, abs=1e-9)
    assert sums.rest_peak_to_peak == pytest.approx(parts.non_repeatable_peak_to_peak, rel=1e-9, abs=1e-9)


def test_a_rest_that_is_far_smaller_than_what_repeats_is_not_lost():
    rng = np.random.default_rng(1)
    waveform, rest = 1e6 * rng.normal(size=84), 1e-6 * rng.normal(size=84 * 50)
    values = np.tile(waveform, 50) + rest
    sums = StreamedPeriods(len(values), 84)
    for piece in np.array_split(values, 7):
        sums.add(piece)
    expected = repeatable_parts(values, 84.0).non_repeatable_rms
    assert sums.rest_rms == pytest.approx(expected, rel=1e-3)
