"""
Composite nonlinear feedback (CNF), a law for seeks: little damping far from the target, much of it close by.

A linear law of low damping moves the head fast; a nonlinear one adds damping as the head comes near, so that it does
not overshoot (Lin, Pachter, Banda, Int. J. Control 70(1), 1998; Chen, Lee, Peng, Venkataramanan, IEEE Trans. Automatic
Control 48(3), 2003, for hard disk drives). For x = (y, v), v' = -c v + a u, and a target r at rest, x_e = (r, 0),

    u = F x + G r + rho B'P (x - x_e),    rho = -beta exp(-alpha |y - r|/|y_0 - r|),
    (A + BF)'P + P (A + BF) = -W.

All of it has a closed form. F places the poles of natural frequency w and damping ratio zeta, G = -F_1 as the drive has
no stiffness, and W = diag(q, q mu/w^2) gives

    F = -(w^2, 2 zeta w - c)/a,    P_12 = q/(2 w^2),    P_22 = q (1 + mu)/(4 zeta w^3).

P scales with q, which rho would take up: q is chosen such that a^2 P_22 = 2 w. Then beta is what the nonlinear part
adds to the damping ratio at the target, at the frequency w; it also stiffens the law, by 1 + 4 zeta beta/(1 + mu).

A seek of length L starts with u = w^2 L/a, so w falls as 1/sqrt(L) where that would exceed a share of u_max. The
integral (enhanced CNF: Peng, Chen, Cheng, Lee, IEEE Trans. Control Systems Technology 13(5), 2005) takes up constant
forces; it counts errors with the weight rho/beta, so that the way to the target does not fill it.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import saturated
from hdd_servo_ros.control.hold import middle_of_hold
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterSet, parameter

Array = NDArray[np.float64]

CNF = layout(
    'gain',
    'limit',
    'friction_rate',
    'square_of_frequency',
    'start_acceleration',
    'damping_ratio',
    'added_damping',
    'added_stiffness',
    'steepness',
    'integral_step',
    'half_sample',
)
"""
Constants: a [um/s^2/V], u_max [V], c [1/s], the largest w^2 [1/s^2], the largest w^2 L [um/s^2], zeta, beta, the
relative stiffness 4 zeta beta/(1 + mu) that the nonlinear part adds at the target, alpha, T times the integral's rate,
T/2 [s].
"""
CNF_STATE = layout('integral')
"""The integral's share of u [V]."""


@dataclasses.dataclass(frozen=True)
class CnfParameters(ParameterSet):
    """Parameters of :func:`cnf_step`."""

    natural_frequency: float = parameter(
        500.0, 'natural frequency of the linear part in short seeks', unit='Hz', above=0.0, maximum=1e6
    )
    damping_ratio: float = parameter(0.3, 'damping ratio zeta of the linear part', minimum=0.01, maximum=2.0)
    start_share: float = parameter(
        1.0,
        'share of the largest voltage with which the linear part may start; it is slower in longer seeks',
        above=0.0,
        maximum=100.0,
    )
    added_damping: float = parameter(
        0.6, 'damping ratio beta that the nonlinear part adds at the target', minimum=0.0, maximum=100.0
    )
    velocity_weight: float = parameter(
        1.0,
        'mu of the weights W = diag(1, mu/w^2) of position and velocity in the Lyapunov equation: the larger, the less '
        'the nonlinear part adds to the stiffness',
        minimum=0.0,
        maximum=1e6,
    )
    steepness: float = parameter(
        3.0, 'exponent alpha: at the start the nonlinear part is exp(-alpha) of that at the target', minimum=0.0
    )
    integral_rate: float = parameter(
        0.0, 'rate of the integral of enhanced CNF against the linear part, 0 for none', unit='1/s', minimum=0.0
    )


def cnf_constants(
    parameters: CnfParameters, gain: float, limit: float, sample_time: float, viscous_coefficient: float = 0.0
) -> Array:
    """
    Return the constants of :func:`cnf_step`, of the layout :data:`CNF`.

    Parameters
    ----------
    parameters
        The law.
    gain
        Acceleration of the head per volt a, above 0 [um/s^2/V].
    limit
        u_max, above 0 [V].
    sample_time
        T [s].
    viscous_coefficient
        Viscous friction c/a that the linear part knows of [V s/um]; 0 where something else cancels it.
    """
    constants = zeros(CNF)
    c = record(constants, CNF)
    c.gain = gain
    c.limit = limit
    c.friction_rate = gain * viscous_coefficient
    c.square_of_frequency = (TWO_PI * parameters.natural_frequency) ** 2
    c.start_acceleration = parameters.start_share * limit * gain
    c.damping_ratio = parameters.damping_ratio
    c.added_damping = parameters.added_damping
    c.added_stiffness = 4.0 * parameters.damping_ratio * parameters.added_damping / (1.0 + parameters.velocity_weight)
    c.steepness = parameters.steepness
    c.integral_step = parameters.integral_rate * sample_time
    c.half_sample = 0.5 * sample_time
    return constants


@compiled
def cnf_gains(c: np.record, nearness: float, length: float) -> tuple[float, float]:
    """
    Return the gains of CNF on error [V/um] and on minus velocity [V s/um] for a value of rho/(-beta).

    Parameters
    ----------
    c
        Record of :data:`CNF`.
    nearness
        exp(-alpha |e|/L), from 0 for the linear part alone to 1 at the target.
    length
        L of the seek, above 0 [um].
    """
    square = min(c.square_of_frequency, c.start_acceleration / length)
    stiffness = square * (1.0 + nearness * c.added_stiffness)
    damping = 2.0 * math.sqrt(square) * (c.damping_ratio + nearness * c.added_damping)
    return stiffness / c.gain, (damping - c.friction_rate) / c.gain


@compiled
def cnf_step(constants: Array, state: Array, error: float, velocity: float, length: float) -> float:
    """
    Return the voltage u of CNF for the sample that begins [V], |u| <= u_max.

    As with PTOS the law holds in the middle of the sample for which u is held.

    Parameters
    ----------
    constants
        Laid out as :data:`CNF`.
    state
        Laid out as :data:`CNF_STATE`; zeros at the start of a seek. The integral moves on.
    error
        e, target less position, at this tick [um].
    velocity
        Of the head, at this tick [um/s].
    length
        L of the seek, magnitude of the error at its start [um]; below 1 nm as 1 nm.
    """
    c = record(constants, CNF)
    s = record(state, CNF_STATE)
    length = max(length, 1e-3)
    middle = error - c.half_sample * velocity
    nearness = exp(-c.steepness * abs(middle) / length)
    stiffness, damping = cnf_gains(c, nearness, length)
    free = (stiffness * middle - damping * velocity) / middle_of_hold(c.gain, c.half_sample, stiffness, damping)
    u = saturated(free + s.integral, c.limit)
    # While the voltage is limited the integral rests.
    if u == free + s.integral:
        s.integral += c.integral_step * nearness * stiffness * error
    return u
