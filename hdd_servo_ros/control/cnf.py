"""
Composite nonlinear feedback (CNF) for seeks: low damping far from the target, high damping close to it.

A linear law of low damping moves the head fast. A nonlinear part adds damping as the head approaches the target, so
that it does not overshoot (Lin, Pachter, Banda, Int. J. Control 70(1), 1998; Chen, Lee, Peng, Venkataramanan, IEEE
Trans. Automatic Control 48(3), 2003, for hard disk drives). For x = (y, v), v' = -c v + a u, and a target r at rest,
x_e = (r, 0),

    u = F x + G r + rho B'P (x - x_e),    rho = -beta exp(-alpha |y - r|/|y_0 - r|),
    (A + BF)'P + P (A + BF) = -W.

The solution has a closed form. F places poles of natural frequency w and damping ratio zeta; G = -F_1 because the drive
has no stiffness; and W = diag(q, q mu/w^2) gives

    F = -(w^2, 2 zeta w - c)/a,    P_12 = q/(2 w^2),    P_22 = q (1 + mu)/(4 zeta w^3).

P scales with q, and so would rho: q is chosen so that a^2 P_22 = 2 w. At the target the law then has the damping
2 (zeta + beta) w and the stiffness w^2 (1 + 4 zeta beta/(1 + mu)).

A seek of length L starts with u = w^2 L/a. Above a certain length, w falls as 1/sqrt(L), so that this initial voltage
is a given fraction of u_max. Close to the target all seeks should behave alike, with natural frequency w_s and damping
ratio zeta_s. With R = w_s/w this gives beta and mu for a length,

    beta = zeta_s R - zeta,    1 + mu = 4 zeta beta/(R^2 - 1),

except that mu is at least 0, which makes the law less stiff than w_s where R is large.

The integral (enhanced CNF: Peng, Chen, Cheng, Lee, IEEE Trans. Control Systems Technology 13(5), 2005) removes the
effect of constant forces. It weights errors by -rho/beta, so that it does not wind up on the way to the target.
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
zeta_s, alpha, T times the integral rate, T/2 [s].
"""
CNF_STATE = layout('integral')
"""Integral part of u [V]."""

SHORTEST = 1e-3
"""Minimum length of a seek [um]; avoids division by zero."""


@dataclasses.dataclass(frozen=True)
class CnfParameters(ParameterSet):
    """Parameters of :func:`cnf_step`."""

    natural_frequency: float = parameter(
        900.0, 'largest natural frequency w of the linear part (short seeks)', unit='Hz', above=0.0, maximum=1e6
    )
    damping_ratio: float = parameter(0.75, 'damping ratio zeta of the linear part', minimum=0.01, maximum=2.0)
    start_share: float = parameter(
        2.7,
        'fraction of the largest voltage with which the linear part starts at most; above 1 it saturates at the start; '
        'long seeks have a lower natural frequency',
        above=0.0,
        maximum=100.0,
    )
    settling_frequency: float = parameter(
        930.0, 'natural frequency w_s at the target, including the nonlinear part', unit='Hz', above=0.0
    )
    settling_damping_ratio: float = parameter(
        0.9, 'damping ratio zeta_s at the target, including the nonlinear part', minimum=0.01, maximum=10.0
    )
    steepness: float = parameter(
        4.0, 'exponent alpha: the nonlinear part starts with exp(-alpha) of its value at the target', minimum=0.0
    )
    integral_rate: float = parameter(
        0.0,
        'rate of the integral relative to the proportional part (enhanced CNF); 0 disables the integral',
        unit='1/s',
        minimum=0.0,
    )

    def check_together(self) -> None:
        """Check that the nonlinear part increases both damping and stiffness."""
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
    Return the constants of :func:`cnf_step`, a record of :data:`CNF`.

    Parameters
    ----------
    parameters
        Parameters of the law.
    gain
        Acceleration of the head per volt a, above 0 [um/s^2/V].
    limit
        u_max, above 0 [V].
    sample_time
        T [s].
    viscous_coefficient
        Viscous friction c/a that the linear part compensates [V s/um]; 0 if a feedforward cancels it.

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
    Return w [rad/s], beta, and the largest relative stiffness that rho adds, for a seek of a given length.

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
    Return the gains on the error [V/um] and on the negative velocity [V s/um] for -rho/beta from 0 to 1.

    Parameters
    ----------
    c
        Record of :data:`CNF`.
    nearness
        exp(-alpha |y - r|/L); 0 for the linear part alone.
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
    Return the voltage u [V] of CNF for the sample that starts now, at most u_max in magnitude.

    As in PTOS, the law holds at the middle of the sample over which u is held.

    Parameters
    ----------
    constants
        A record of :data:`CNF`.
    state
        A record of :data:`CNF_STATE`; zeros at the start of a seek. The integral is advanced in place.
    error
        e = r - y, target minus position, at this tick [um].
    velocity
        Velocity of the head at this tick [um/s].
    length
        L, the magnitude of the error r - y_0 at the start of the seek [um].

    Notes
    -----
    Source: Chen, Lee, Peng, Venkataramanan, IEEE Trans. Automatic Control 48(3), 2003.

    Examples
    --------
    Seek of a free body over 0.1 mm, until it is within 10 nm; without an integral the state is a single zero:

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
