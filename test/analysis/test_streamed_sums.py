"""Sums over a signal that comes in pieces, against the same from the whole signal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.analysis.metrics import control_effort, loop_area
from hdd_servo_ros.analysis.off_track import off_track
from hdd_servo_ros.analysis.streamed_sums import StreamedLoopArea, StreamedOffTrack, StreamedVariation

from .cut import pieces, signals_in_pieces

T = 1e-4


@given(signals_in_pieces())
def test_variation(given_signal):
    values, cuts = given_signal
    found = StreamedVariation()
    for piece in pieces(values, cuts):
        found.add(piece)
    assert found.total == pytest.approx(control_effort(values).total_variation, rel=1e-9, abs=1e-12)


@given(signals_in_pieces(), st.integers(1, 5))
def test_loop_area(given_signal, cycles):
    values, cuts = given_signal
    force = np.cos(np.arange(len(values)))
    found = StreamedLoopArea()
    for x, f in zip(pieces(values, cuts), pieces(force, cuts), strict=True):
        found.add(x, f)
    assert found.area(cycles) == pytest.approx(loop_area(values, force, cycles), rel=1e-6, abs=1e-6)


@given(signals_in_pieces(), st.sampled_from([0.0, 0.5, 1.0, 2.0, 1e9]), st.booleans())
def test_off_track(given_signal, limit, is_broken):
    values, cuts = given_signal
    if is_broken:
        values[len(values) // 2] = np.nan
    found = StreamedOffTrack(limit)
    for piece in pieces(values, cuts):
        found.add(piece)
    expected = off_track(values, limit, T)
    assert found.count / len(values) == expected.fraction
    assert found.longest * T == expected.longest
