import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.messages.ticks import Ticks

SAMPLE_TIMES = [1e-4, 2e-5, 1e-3, 1e-9, 62.5e-6, 0.1]


@given(st.sampled_from(SAMPLE_TIMES), st.integers(0, 2**31 * 9))
def test_a_stamp_tells_its_tick(sample_time, tick):
    ticks = Ticks(sample_time)
    if ticks.nanoseconds(tick) < 2**31 * 1_000_000_000:
        assert ticks.tick_of(ticks.stamp(tick)) == tick
    assert ticks.tick_of_seconds(ticks.seconds_bytes(tick)) == tick


def test_times_are_exact_integers():
    assert Ticks(1e-4).nanoseconds(123_456_789) == 12_345_678_900_000


def test_a_stamp_between_ticks():
    assert Ticks(2e-4).tick_of(Ticks(1e-4).stamp(3)) == 1.5


@pytest.mark.parametrize('sample_time', [0.0, -1e-4, 1e-10, 1.23456789e-4 + 5e-10])
def test_a_time_that_is_no_whole_number_of_nanoseconds_is_rejected(sample_time):
    with pytest.raises(ValueError, match='integer number of nanoseconds'):
        Ticks(sample_time)
