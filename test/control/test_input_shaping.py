"""Input shaping: steps are applied in two parts, smooth references are unchanged."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.control.input_shaping import SHAPING_STATE, fill_shaped, shaped
from hdd_servo_ros.numerics.records import record, zeros

SHARE, TICKS = 0.25, 3


def of(x_d, dx_d=None, share=SHARE, ticks=TICKS):
    out = np.array(x_d, dtype=float)
    velocity = np.zeros(len(out)) if dx_d is None else np.array(dx_d, dtype=float)
    fill_shaped(zeros(SHAPING_STATE), out, velocity, share, float(ticks))
    return out.tolist()


def test_a_jump_is_taken_in_two_parts():
    assert of([0, 0, 4, 4, 4, 4, 4]) == [0, 0, 3, 3, 3, 4, 4]
    assert of([4, 4, 4, 4, -4, -4, -4, -4]) == [3, 3, 3, 4, -2, -2, -2, -4]


def test_jumps_sooner_than_the_delay_wait_together():
    assert of([4, 4, 8, 8, 8, 8]) == [3, 3, 6, 6, 6, 8]


def test_without_share_or_delay_nothing_changes():
    x_d = [4.0, 4.0, -0.1, 7.3]
    assert of(x_d, share=0.0) == of(x_d, ticks=0) == x_d


def test_switched_off_it_gives_all_at_once_and_does_not_come_back():
    state = record(zeros(SHAPING_STATE), SHAPING_STATE)
    assert shaped(state, 4.0, 0.0, SHARE, 3.0) == 3.0
    assert shaped(state, 4.0, 0.0, 0.0, 3.0) == 4.0
    assert shaped(state, 4.0, 0.0, SHARE, 3.0) == 4.0


@given(st.lists(st.tuples(st.floats(-10, 10), st.sampled_from([0.0, 1.0, -5.0])), min_size=1, max_size=40))
def test_as_said_in_words(rows):
    """The delayed part is the share of all steps since the last ``TICKS`` ticks without a step."""
    x_d, dx_d = np.array(rows).T
    before, velocity_before = np.append(0.0, x_d[:-1]), np.append(0.0, dx_d[:-1])
    jumps = np.where((dx_d == 0.0) & (velocity_before == 0.0), x_d - before, 0.0)
    held, quiet, expected = 0.0, TICKS, []
    for position, jump in zip(x_d, jumps, strict=True):
        quiet = 0 if jump else quiet + 1
        held = 0.0 if quiet >= TICKS else held + SHARE * jump
        expected.append(position - held)
    assert of(x_d, dx_d) == pytest.approx(expected, abs=1e-12)


def test_a_smooth_reference_is_left_alone():
    t = np.arange(2000) * 1e-4
    assert of(2.0 * np.sin(200.0 * np.pi * t), 400.0 * np.pi * np.cos(200.0 * np.pi * t)) == of(
        2.0 * np.sin(200.0 * np.pi * t), share=0.0
    )
