"""
Proximate time-optimal servomechanism (PTOS) for seeks: nearly time-optimal, and linear close to the target.

Time-optimal control of a free body x'' = a u, |u| <= u_max, brakes along v = sgn(e) sqrt(2 a u_max |e|), e = r - x. It
chatters at the target and has no reserve for a weaker drive. PTOS (Workman, Adaptive Proximate Time-Optimal
Servomechanisms, Stanford, 1987; Franklin, Powell, Workman, Digital Control of Dynamic Systems) brakes with a fraction
alpha of u_max, the acceleration discount factor, and replaces the end of the curve by its tangent:

    u = sat(k2 (f(e) - v)),
    f(e) = (k1/k2) e                                               for |e| <= y_l = u_max/k1,
           sgn(e) (sqrt(2 a alpha u_max |e|) - u_max/k2)           beyond.

f and its slope are continuous at y_l only if k2 = sqrt(2 k1/(a alpha)). Two parameters remain: the natural frequency w
of the linear region, k1 = w^2/a, and the discount factor, which sets the damping ratio 1/sqrt(2 alpha).
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import saturated
from hdd_servo_ros.control.hold import middle_of_hold
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterSet, parameter

Array = NDArray[np.float64]

PTOS = layout('gain', 'limit', 'k1', 'k2', 'linear_error', 'linear_slope', 'curve', 'offset', 'lag', 'half_sample')
"""
Constants: a [um/s^2/V], u_max [V], k1 [V/um], k2 [V s/um], y_l [um], k1/k2 [1/s], 2 a alpha u_max [um/s^2],
u_max/k2 [um/s], lag and T/2 [s].
"""


@dataclasses.dataclass(frozen=True)
class PtosParameters(ParameterSet):
    """Parameters of :func:`ptos_step`."""

    natural_frequency: float = parameter(
        700.0, 'natural frequency w of the linear region, for a free body', unit='Hz', above=0.0, maximum=1e6
    )
    discount: float = parameter(
        0.9,
        'acceleration discount factor alpha: fraction of the largest voltage used for braking; the damping ratio of '
        'the linear region is 1/sqrt(2 alpha)',
        minimum=0.05,
        maximum=0.999,
    )
    lag: float = parameter(
        0.0,
        'lag of actuator, computation and resonances, over which error and velocity are predicted with the previous '
        'voltage (extended PTOS); 0 disables the prediction; half a sample of the hold is always compensated',
        unit='s',
        minimum=0.0,
        maximum=0.01,
    )

    @property
    def damping_ratio(self) -> float:
        """Damping ratio of the linear region, for a free body."""
        return math.sqrt(0.5 / self.discount)


def ptos_constants(parameters: PtosParameters, gain: float, limit: float, sample_time: float) -> Array:
    """
    Return the constants of :func:`ptos_step`, a record of :data:`PTOS`.

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

    Notes
    -----
    Source: Workman, Adaptive Proximate Time-Optimal Servomechanisms, Stanford, 1987.

    Examples
    --------
    >>> from hdd_servo_ros.control import PtosParameters, ptos_constants
    >>> ptos_constants(PtosParameters(), gain=4.0968e7, limit=10.0, sample_time=1e-4).shape
    (10,)
    """
    frequency = TWO_PI * parameters.natural_frequency
    constants = zeros(PTOS)
    c = record(constants, PTOS)
    c.gain = gain
    c.limit = limit
    c.k1 = frequency * frequency / gain
    c.k2 = math.sqrt(2.0 * c.k1 / (gain * parameters.discount))
    c.linear_error = limit / c.k1
    c.linear_slope = c.k1 / c.k2
    c.curve = 2.0 * gain * parameters.discount * limit
    c.offset = limit / c.k2
    c.lag = parameters.lag
    c.half_sample = 0.5 * sample_time
    return constants


@compiled
def ptos_velocity(c: np.record, error: float) -> tuple[float, float]:
    """Return the commanded velocity f(e) [um/s] at an error e [um], and its slope [1/s]; ``c`` is a :data:`PTOS`."""
    distance = abs(error)
    if distance <= c.linear_error:
        return c.linear_slope * error, c.linear_slope
    root = math.sqrt(c.curve * distance)
    return math.copysign(root - c.offset, error), 0.5 * root / distance


@compiled
def ptos_step(constants: Array, error: float, velocity: float, last_control: float) -> float:
    """
    Return the voltage u [V] of PTOS for the sample that starts now, at most u_max in magnitude.

    The law holds at the middle of the sample over which u is held: exactly in the linear region, and with the tangent
    of f outside it.

    Parameters
    ----------
    constants
        A record of :data:`PTOS`.
    error
        e, target minus position, at this tick [um].
    velocity
        Velocity of the head at this tick [um/s].
    last_control
        Voltage of the previous sample without the friction compensation [V]; used only with a lag.

    Notes
    -----
    Source: Workman, Adaptive Proximate Time-Optimal Servomechanisms, Stanford, 1987.

    Examples
    --------
    Seek of a free body over 0.1 mm, until it is within 10 nm:

    >>> from hdd_servo_ros.control import PtosParameters, ptos_constants, ptos_step
    >>> gain, sample_time = 4.0968e7, 1e-4
    >>> constants = ptos_constants(PtosParameters(), gain, limit=10.0, sample_time=sample_time)
    >>> position = velocity = u = 0.0
    >>> tick = 0
    >>> while abs(100.0 - position) > 0.01:
    ...     u = ptos_step(constants, 100.0 - position, velocity, u)
    ...     position += sample_time * velocity + 0.5 * gain * u * sample_time**2
    ...     velocity += gain * u * sample_time
    ...     tick += 1
    >>> f'{1e3 * tick * sample_time:.1f} ms'
    '3.0 ms'
    """
    c = record(constants, PTOS)
    rise = c.gain * last_control * c.lag
    error -= c.lag * (velocity + 0.5 * rise)
    velocity += rise
    wanted, slope = ptos_velocity(c, error - c.half_sample * velocity)
    u = c.k2 * (wanted - velocity) / middle_of_hold(c.gain, c.half_sample, c.k2 * slope, c.k2)
    return saturated(u, c.limit)
