import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hdd_servo_ros.reporting.decimation import rows_to_draw

signals = arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e3, 1e3))


@given(signals, st.integers(1, 50), st.integers(0, 400), st.integers(0, 30))
def test_no_peak_is_lost_and_a_stretch_is_whole(values, buckets, start, length):
    rows = rows_to_draw(values, buckets, [slice(start, start + length)])
    assert np.all(np.diff(rows) > 0)
    assert (rows[0], rows[-1]) == (0, len(values) - 1)
    assert {*range(start, min(start + length, len(values)))} <= {*rows.tolist()}
    size = -(-len(values) // buckets)
    for begin in range(0, len(values), size):
        inside = rows[(rows >= begin) & (rows < begin + size)]
        assert values[inside].max() == values[begin : begin + size].max()
        assert values[inside].min() == values[begin : begin + size].min()


def test_a_long_signal_becomes_short():
    values = np.random.default_rng(1).normal(size=100_001)
    assert 4000 < len(rows_to_draw(values, 2500)) <= 5002
    assert len(rows_to_draw(values[:100], 50)) == 100
