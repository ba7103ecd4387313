"""
Desired compensation: feedforward computed from the reference alone and adapted by the error.

Sadegh and Horowitz (Int. J. Robotics Research 9(3), 1990) replace the measured regressors of an adaptive law by those
of the reference. The estimates are then outside the feedback loop, and the regressors contain no noise. The friction of
the reference is modeled by two bristles. They are rate independent, as in Dahl's model, which is LuGre's (2.21) with a
constant g = sigma_0 d:

    z' = x_d' - |x_d'| z/d.

docs/controllers/adaptive-nn.md has the law and its effect, docs/concepts/stability-certificate.md the proof.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.numerics.records import layout

REGRESSORS = ('velocity', 'acceleration', 'spring', 'hysteresis', 'relaxation')
"""Columns of the history: x_d', x_d'', z_2, z_1 - z_2 and -|x_d'| z_1/d_1."""

VELOCITY, ACCELERATION, SPRING, HYSTERESIS, RELAXATION = range(len(REGRESSORS))

DESIRED = layout('enabled', 'has_bristles', 'decay', 'distance', 'spring_distance')
"""Constants: ``decay`` is the factor by which a peak decays per tick; distances d_1 and d_2 in um."""

DESIRED_STATE = layout('reference', 'bristle', 'spring', 'row', ('peaks', layout(*REGRESSORS)))
"""Last x_d, z_1 and z_2 [um], row of the history that was written last, squares of the held peaks."""


@compiled
def bristle_after(deflection: float, change: float, distance: float) -> float:
    """
    Return the deflection z [um] of a bristle after the reference has moved monotonically by ``change`` [um].

    Exact solution of dz/dx = 1 - z sgn(x')/d, so that ``|z|`` never exceeds ``distance`` d [um].
    """
    if change == 0.0:
        return deflection
    limit = distance if change > 0.0 else -distance
    return limit + (deflection - limit) * exp(-abs(change) / distance)


@compiled
def advance(c: Any, s: Any, x_d: float, dx_d: float, ddx_d: float, history: NDArray[np.float64]) -> int:
    """
    Write the regressors of a tick into ``history``, a ring buffer of rows, and return the row; the next is the oldest.

    Parameters
    ----------
    c, s
        Records of ``DESIRED`` and ``DESIRED_STATE``.
    x_d, dx_d, ddx_d
        Reference [um], its velocity [um/s] and its acceleration [um/s^2].
    history
        Regressors of the previous ticks, shape (ticks of the lag + 1, 5).
    """
    last = int(s.row)
    row = (last + 1) % len(history)
    s.row = float(row)
    # The bristles do not follow a step of the reference: the integral already provides part of its force.
    moves = dx_d != 0.0 or history[last, VELOCITY] != 0.0
    history[row, VELOCITY] = dx_d
    history[row, ACCELERATION] = ddx_d
    s.peaks.velocity = max(dx_d * dx_d, c.decay * s.peaks.velocity)
    s.peaks.acceleration = max(ddx_d * ddx_d, c.decay * s.peaks.acceleration)
    if c.has_bristles != 0.0:
        change = x_d - s.reference if moves else 0.0
        s.bristle = bristle_after(s.bristle, change, c.distance)
        s.spring = bristle_after(s.spring, change, c.spring_distance)
        hysteresis = s.bristle - s.spring
        relaxation = -abs(dx_d) * s.bristle / c.distance
        history[row, SPRING] = s.spring
        history[row, HYSTERESIS] = hysteresis
        history[row, RELAXATION] = relaxation
        s.peaks.spring = max(s.spring * s.spring, c.decay * s.peaks.spring)
        s.peaks.hysteresis = max(hysteresis * hysteresis, c.decay * s.peaks.hysteresis)
        s.peaks.relaxation = max(relaxation * relaxation, c.decay * s.peaks.relaxation)
    s.reference = x_d
    return row


@compiled
def learning_signal(law: Any, peak: float, regressor: float, r: float) -> float:
    """Return -phi r/(1 + p^2/s^2), the input of a normalized law; ``peak`` is p^2, ``law.normalization`` is 1/s^2."""
    return -regressor * r / (1.0 + law.normalization * peak)  # type: ignore[no-any-return]
