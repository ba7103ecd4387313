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

P scales with q, which rho would take up: q is chosen such that a^2 P_22 = 2 w. At the target the law then has the
damping 2 (zeta + beta) w and the stiffness w^2 (1 + 4 zeta beta/(1 + mu)).

A seek of length L starts with u = w^2 L/a. Beyond some length w falls as 1/sqrt(L), so that this is a given share of
u_max. Close to the target all seeks shall be alike, with a natural frequency w_s and a damping ratio zeta_s. From these
follow beta and mu of a length, with R = w_s/w,

    beta = zeta_s R - zeta,    1 + mu = 4 zeta beta/(R^2 - 1),

except that mu is at least 0, and the law less stiff than w_s where R is large.

The integral (enhanced CNF: Peng, Chen, Cheng, Lee, IEEE Trans. Control Systems Technology 13(5), 2005) takes up
constant forces; it counts errors with the weight -rho/beta, so that the way to the target does not fill it.
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
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

Array = NDArray[np.float64]

CNF = layout(
    'gain',
    'limit',
    'friction_rate',
    'frequency',
    'start_acceleration',
    'damping_ratio',
    'settling_frequency',
    'settling_damping_ratio',
    'steepness',
    'integral_step',
    'half_sample',
)
"""
Constants: a [um/s^2/V], u_max [V], c [1/s], the largest w [rad/s], the largest w^2 L [um/s^2], zeta, w_s [rad/s],
zeta_s, alpha, T times the integral's rate, T/2 [s].
"""
CNF_STATE = layout('integral')
"""The integral's share of u [V]."""

SHORTEST = 1e-3
"""Least length of a seek [um], by which distances are divided."""


@dataclasses.dataclass(frozen=True)
class CnfParameters(ParameterSet):
    """Parameters of :func:`cnf_step`."""

    natural_frequency: float = parameter(
        900.0, 'largest natural frequency w of the linear part, that in short seeks', unit='Hz', above=0.0, maximum=1e6
    )
    damping_ratio: float = parameter(0.75, 'damping ratio zeta of the linear part', minimum=0.01, maximum=2.0)
    start_share: float = parameter(
        2.7,
        'share of the largest voltage with which the linear part may start, above 1 to saturate there; its natural '
        'frequency is lower in longer seeks',
        above=0.0,
        maximum=100.0,
    )
    settling_frequency: float = parameter(
        930.0, 'natural frequency w_s of the law at the target, nonlinear part included', unit='Hz', above=0.0
    )
    settling_damping_ratio: float = parameter(
        0.9, 'damping ratio zeta_s of the law at the target, nonlinear part included', minimum=0.01, maximum=10.0
    )
    steepness: float = parameter(
        4.0, 'exponent alpha: at the start the nonlinear part is exp(-alpha) of that at the target', minimum=0.0
    )
    integral_rate: float = parameter(
        0.0, 'rate of the integral of enhanced CNF against the proportional part, 0 for none', unit='1/s', minimum=0.0
    )

    def check_together(self) -> None:
        """Check that the nonlinear part adds damping and stiffness, and takes off neither."""
        if self.settling_frequency < self.natural_frequency:
            allowed = f'at least natural_frequency, which is {self.natural_frequency:g} [Hz]'
            raise ParameterError('settling_frequency', self.settling_frequency, allowed)
        if self.settling_damping_ratio < self.damping_ratio:
            allowed = f'at least damping_ratio, which is {self.damping_ratio:g}'
            raise ParameterError('settling_damping_ratio', self.settling_damping_ratio, allowed)


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
        Viscous friction c/a that the linear part allows for [V s/um]; 0 where a feedforward cancels it.

    Notes
    -----
    Source: Chen, Lee, Peng, Venkataramanan, IEEE Trans. Automatic Control 48(3), 2003.

    Examples
    --------
    >>> from hdd_servo_ros.control import CnfParameters, cnf_constants
    >>> cnf_constants(CnfParameters(), gain=4.0968e7, limit=10.0, sample_time=1e-4).shape
    (11,)
    """
    constants = zeros(CNF)
    c = record(constants, CNF)
    c.gain = gain
    c.limit = limit
    c.friction_rate = gain * viscous_coefficient
    c.frequency = TWO_PI * parameters.natural_frequency
    c.start_acceleration = parameters.start_share * limit * gain
    c.damping_ratio = parameters.damping_ratio
    c.settling_frequency = TWO_PI * parameters.settling_frequency
    c.settling_damping_ratio = parameters.settling_damping_ratio
    c.steepness = parameters.steepness
    c.integral_step = parameters.integral_rate * sample_time
    c.half_sample = 0.5 * sample_time
    return constants


@compiled
def cnf_design(c: np.record, length: float) -> tuple[float, float, float]:
    """
    Return what the law of a seek of a length has: w [rad/s], beta, and the relative stiffness that rho adds at most.

    Parameters
    ----------
    c
        Record of :data:`CNF`.
    length
        L, above 0 [um].
    """
    frequency = min(c.frequency, math.sqrt(c.start_acceleration / length))
    ratio = c.settling_frequency / frequency
    beta = c.settling_damping_ratio * ratio - c.damping_ratio
    # 4 zeta beta/(1 + mu) with mu >= 0.
    return frequency, beta, min(ratio * ratio - 1.0, 4.0 * c.damping_ratio * beta)


@compiled
def cnf_gains(c: np.record, nearness: float, length: float) -> tuple[float, float]:
    """
    Return the gains on error [V/um] and on minus velocity [V s/um], for a value of rho/(-beta) from 0 to 1.

    Parameters
    ----------
    c
        Record of :data:`CNF`.
    nearness
        exp(-alpha |y - r|/L), with 0 for the linear part alone.
    length
        L, above 0 [um].
    """
    frequency, beta, added = cnf_design(c, length)
    stiffness = frequency * frequency * (1.0 + nearness * added)
    damping = 2.0 * frequency * (c.damping_ratio + nearness * beta)
    return stiffness / c.gain, (damping - c.friction_rate) / c.gain


@compiled
def cnf_step(constants: Array, state: Array, error: float, velocity: float, length: float) -> float:
    """
    Return the voltage u of CNF for the sample that begins [V], at most u_max in magnitude.

    As with PTOS the law holds in the middle of the sample for which u is held.

    Parameters
    ----------
    constants
        Laid out as :data:`CNF`.
    state
        Laid out as :data:`CNF_STATE`; zeros at the start of a seek. The integral is advanced.
    error
        e = r - y, target less position, at this tick [um].
    velocity
        Of the head, at this tick [um/s].
    length
        L, magnitude of r - y_0, the error at the start of the seek [um].

    Notes
    -----
    Source: Chen, Lee, Peng, Venkataramanan, IEEE Trans. Automatic Control 48(3), 2003.

    Examples
    --------
    A seek of a free body over 100 um, to within 10 nm; without an integral the state is one zero:

    >>> import numpy as np
    >>> from hdd_servo_ros.control import CnfParameters, cnf_constants, cnf_step
    >>> gain, sample_time = 4.0968e7, 1e-4
    >>> constants = cnf_constants(CnfParameters(), gain, limit=10.0, sample_time=sample_time)
    >>> state = np.zeros(1)
    >>> position = velocity = 0.0
    >>> tick = 0
    >>> while abs(100.0 - position) > 0.01:
    ...     u = cnf_step(constants, state, 100.0 - position, velocity, 100.0)
    ...     position += sample_time * velocity + 0.5 * gain * u * sample_time**2
    ...     velocity += gain * u * sample_time
    ...     tick += 1
    >>> f'{1e3 * tick * sample_time:.1f} ms'
    '1.4 ms'
    """
    c = record(constants, CNF)
    s = record(state, CNF_STATE)
    length = max(length, SHORTEST)
    middle = error - c.half_sample * velocity
    nearness = exp(-c.steepness * abs(middle) / length)
    stiffness, damping = cnf_gains(c, nearness, length)
    wanted = (stiffness * middle - damping * velocity) / middle_of_hold(c.gain, c.half_sample, stiffness, damping)
    wanted += s.integral
    u = saturated(wanted, c.limit)
    # The integral is frozen while u is saturated.
    if u == wanted:
        s.integral += c.integral_step * nearness * stiffness * error
    return u
