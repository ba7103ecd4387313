"""Input shaping of a reference's jumps (Singer and Seering, ASME J. Dyn. Syst. Meas. Control 112, 1990)."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled

STATE_SIZE = 4
# Where its state stands, from a start on: the last reference and its velocity, what is held back, for how many ticks.
LAST_POSITION, LAST_VELOCITY, HELD, TICKS = range(STATE_SIZE)


@compiled
def shaped(state: NDArray[np.float64], start: int, x_d: float, dx_d: float, share: float, ticks: float) -> float:
    """
    Return the reference of a tick without the part of its last jumps that is still held back.

    A jump is a change of x_d between two ticks at both of which x_d' = 0, so that a smooth reference has none. Before
    the first tick the reference counts as zero. Jumps that follow each other sooner than ``ticks`` wait together.

    Parameters
    ----------
    state
        Holds the four numbers of this filter from ``start`` on; zeros at first.
    start
        Where they stand.
    x_d, dx_d
        Reference [um] and its velocity [um/s].
    share
        Part of a jump that is held back; with 0 the reference is returned as it is.
    ticks
        For how many ticks.
    """
    jump = 0.0
    if dx_d == 0.0 and state[start + LAST_VELOCITY] == 0.0:
        jump = x_d - state[start + LAST_POSITION]
    state[start + LAST_POSITION] = x_d
    state[start + LAST_VELOCITY] = dx_d
    if state[start + TICKS] > 0.0:
        state[start + TICKS] -= 1.0
    if jump != 0.0 and share > 0.0:
        state[start + HELD] += share * jump
        state[start + TICKS] = ticks
    if state[start + TICKS] == 0.0 or share == 0.0:
        state[start + HELD] = 0.0
        return x_d
    return x_d - state[start + HELD]  # type: ignore[no-any-return]


@compiled
def fill_shaped(
    state: NDArray[np.float64], x_d: NDArray[np.float64], dx_d: NDArray[np.float64], share: float, ticks: float
) -> None:
    """Replace x_d (n,) of consecutive ticks by what :func:`shaped` makes of it."""
    for row in range(len(x_d)):
        x_d[row] = shaped(state, 0, x_d[row], dx_d[row], share, ticks)
