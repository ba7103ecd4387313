"""Input shaping of reference steps (Singer and Seering, ASME J. Dyn. Syst. Meas. Control 112, 1990)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout, record

# Last reference and its velocity, delayed part of the steps, and remaining ticks of the delay; initially zero.
SHAPING_STATE = layout('last_position', 'last_velocity', 'held', 'ticks')


@compiled
def shaped(s: Any, x_d: float, dx_d: float, share: float, ticks: float) -> float:
    """
    Return the reference of a tick without the part of its last steps that is still delayed.

    A step is a change of x_d between two ticks at which x_d' = 0, so that a smooth reference has none. Before the first
    tick the reference counts as zero. Steps closer together than ``ticks`` share one delay.

    Parameters
    ----------
    s
        State of the filter, a record of ``SHAPING_STATE``.
    x_d, dx_d
        Reference [um] and its velocity [um/s].
    share
        Fraction of a step that is delayed; with 0 the reference is returned unchanged.
    ticks
        Delay in ticks.
    """
    step = 0.0
    if dx_d == 0.0 and s.last_velocity == 0.0:
        step = x_d - s.last_position
    s.last_position = x_d
    s.last_velocity = dx_d
    if s.ticks > 0.0:
        s.ticks -= 1.0
    if step != 0.0 and share > 0.0:
        s.held += share * step
        s.ticks = ticks
    if s.ticks == 0.0 or share == 0.0:
        s.held = 0.0
        return x_d
    return x_d - s.held  # type: ignore[no-any-return]


@compiled
def fill_shaped(
    state: NDArray[np.float64], x_d: NDArray[np.float64], dx_d: NDArray[np.float64], share: float, ticks: float
) -> None:
    """Apply :func:`shaped` in place to x_d (n,) of consecutive ticks; ``state`` is a record of ``SHAPING_STATE``."""
    s = record(state, SHAPING_STATE)
    for row in range(len(x_d)):
        x_d[row] = shaped(s, x_d[row], dx_d[row], share, ticks)
