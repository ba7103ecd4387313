"""Velocity estimation from measured positions: Kalman filter or filtered differences."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI, exp
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.numerics.transition import held_input_transition
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

Array = NDArray[np.float64]
ObserverArrays = tuple[Array, Array, Array]
"""Records of constants, state and estimates."""

METHODS = ('kalman', 'difference')
DIGITS = 12
"""Significant digits of the rounded gains, since LAPACK's results differ in the last bits between machines."""

OBSERVER = layout('a11', 'a12', 'a21', 'a22', 'b1', 'b2', 'gain_1', 'gain_2', 'per_second')
"""State transition of (position, velocity times T) over a sample, its response to u, filter gains, and 1/T [1/s]."""
OBSERVER_STATE = layout('position', 'travel', 'has_started')
ESTIMATE_NAMES = ('observed_position', 'observed_velocity')
ESTIMATES = layout(*ESTIMATE_NAMES)


@dataclasses.dataclass(frozen=True)
class ObserverParameters(ParameterSet):
    """Parameters of :class:`Observer`."""

    method: str = parameter(
        'kalman',
        'kalman: steady-state Kalman filter of the rigid drive with its command; difference: filtered difference of '
        'the position',
        choices=METHODS,
    )
    bandwidth: float = parameter(
        2000.0,
        'kalman: natural frequency of its poles for a free body and short T, which sets the ratio of the noise '
        'densities; difference: corner frequency of the first-order low pass',
        unit='Hz',
        minimum=10.0,
        maximum=1e7,
    )
    gain: float = parameter(4.0968e7, 'acceleration of the head per volt in the model', unit='um/s^2/V', minimum=0.0)
    stiffness: float = parameter(
        0.02168, 'presliding stiffness of the pivot friction in the model', unit='V/um', minimum=0.0
    )
    viscous_coefficient: float = parameter(
        6.9e-6, 'viscous friction coefficient in the model', unit='V s/um', minimum=0.0
    )


@dataclasses.dataclass(frozen=True)
class ControllerObserverParameters(ParameterSet):
    """Parameters of every controller node for a sensor without velocity output."""

    observer: ObserverParameters = group(ObserverParameters)


@compiled
def observed(c: np.record, position: float, travel: float, measured: float, control: float) -> tuple[float, float]:
    """
    Return the next estimates of position [um] and of velocity times T [um].

    Parameters
    ----------
    c
        Record of :data:`OBSERVER`.
    position, travel
        Estimates of the previous sample [um].
    measured
        Newly measured position [um].
    control
        Drive voltage held since the previous sample [V].
    """
    predicted = c.a11 * position + c.a12 * travel + c.b1 * control
    ahead = c.a21 * position + c.a22 * travel + c.b2 * control
    innovation = measured - predicted
    return predicted + c.gain_1 * innovation, ahead + c.gain_2 * innovation


@compiled_apart
def observer_step(
    constants: Array, state: Array, estimates: Array, position: float, control: float
) -> tuple[float, float]:
    """Return the estimated position [um] and velocity [um/s]; see :meth:`Observer.step`."""
    c = record(constants, OBSERVER)
    s = record(state, OBSERVER_STATE)
    if s.has_started != 0.0:
        s.position, s.travel = observed(c, s.position, s.travel, position, control)
    else:
        s.position, s.travel, s.has_started = position, 0.0, 1.0
    found = record(estimates, ESTIMATES)
    found.observed_position = s.position
    found.observed_velocity = s.travel * c.per_second
    return found.observed_position, found.observed_velocity


class Observer:
    """
    Observer of the velocity from one position per sample and the command held between samples.

    ``kalman`` is the steady-state Kalman filter of the rigid drive m x'' + c x' + s x = u, exactly discretized with u
    held. Its process noise is a white force. Its measurement noise is white, with 1/w^4 of the density of the
    acceleration. The continuous filter of a free body then has its poles at w exp(+-135 degrees), w = 2 pi bandwidth.
    The gains follow from the discrete algebraic Riccati equation. ``difference`` is the difference of two positions
    over T, followed by a first-order low pass with the pole exp(-w T); it does not use the command.

    The initial state is the first measured position at rest.

    Parameters
    ----------
    parameters
        Method, bandwidth, model.
    sample_time
        T [s].

    Attributes
    ----------
    estimates
        Estimated position [um] and velocity [um/s].

    Notes
    -----
    Source: standard steady-state Kalman filter; ``docs/instruments/servo-sensor.md`` has its model.

    Examples
    --------
    Head that moves at 1 mm/s without a command, of which only the position is measured:

    >>> from hdd_servo_ros.control import Observer, ObserverParameters
    >>> observer = Observer(ObserverParameters(stiffness=0.0, viscous_coefficient=0.0), sample_time=1e-4)
    >>> for tick in range(50):
    ...     position, velocity = observer.step(1000.0 * 1e-4 * tick, 0.0)
    >>> round(position, 6), round(velocity, 3)  # um, um/s
    (4.9, 1000.0)
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: ObserverParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state = zeros(OBSERVER_STATE)
        self.estimates = zeros(ESTIMATES)
        self.update(parameters)

    def update(self, parameters: ObserverParameters) -> None:
        """Use new parameters from the next tick on; position and velocity are kept."""
        self.parameters = parameters
        constants = zeros(OBSERVER)
        c = record(constants, OBSERVER)
        matrices = filter_matrices(parameters, self.sample_time)
        (c.a11, c.a12), (c.a21, c.a22) = matrices.transition
        c.b1, c.b2 = matrices.response
        c.gain_1, c.gain_2 = matrices.gains
        c.per_second = 1.0 / self.sample_time
        self.arrays: ObserverArrays = (constants, self.state, self.estimates)

    def step(self, position: float, control: float) -> tuple[float, float]:
        """
        Return the estimated position [um] and velocity [um/s] at a tick.

        Parameters
        ----------
        position
            Position measured at this tick [um].
        control
            Drive voltage held since the previous tick [V].
        """
        return observer_step(*self.arrays, position, control)


def standing_bias(c: np.record) -> float:
    """
    Return the estimated velocity of a head at rest per position [1/s]; 0 without a spring.

    Parameters
    ----------
    c
        Record of :data:`OBSERVER`.
    """
    # Fixed point of p = p^- + l1 (1 - p^-), w = w^- + l2 (1 - p^-) with (p^-, w^-) = A (p, w), for a position of 1.
    m11, m12 = 1.0 - (1.0 - c.gain_1) * c.a11, -(1.0 - c.gain_1) * c.a12
    m21, m22 = c.gain_2 * c.a11 - c.a21, 1.0 + c.gain_2 * c.a12 - c.a22
    return float((m11 * c.gain_2 - m21 * c.gain_1) / (m11 * m22 - m12 * m21) * c.per_second)


@dataclasses.dataclass(frozen=True)
class FilterMatrices:
    """
    Matrices of an observer x^-_k = A x_{k-1} + B u_{k-1}, x_k = x^-_k + L (y_k - C x^-_k), C = (1, 0).

    The states are the position [um] and the velocity times T [um].
    """

    transition: Array
    response: Array
    gains: Array


def filter_matrices(parameters: ObserverParameters, sample_time: float) -> FilterMatrices:
    """
    Return the matrices of an observer at T [s].

    Raises
    ------
    ParameterError
        If the Riccati equation has no floating-point solution: the bandwidth is far too low for a stiff model.
    """
    frequency = TWO_PI * parameters.bandwidth
    if parameters.method == 'difference':
        smoothing = 1.0 - exp(-frequency * sample_time)
        # The state is the last position, so that the innovation is the difference.
        return FilterMatrices(np.diag([1.0, 1.0 - smoothing]), np.zeros(2), np.array([1.0, smoothing]))
    # Imported late: it takes a tenth of a second, and only runs with this filter need it.
    from scipy.linalg import solve_discrete_are

    gain, rate = parameters.gain, 1.0 / sample_time
    dynamics = [
        [0.0, rate],
        [-gain * parameters.stiffness * sample_time, -gain * parameters.viscous_coefficient],
    ]
    transition, response = (
        np.array(found) for found in held_input_transition(dynamics, [0.0, gain * sample_time], sample_time)
    )
    # White acceleration, with w^4 T of the density of the measurement noise, integrated twice over a sample. T is small
    # compared with the drive's time constants, so it acts as on a free body.
    density = (frequency * sample_time) ** 4
    process = density * np.array([[1.0 / 3.0, 0.5], [0.5, 1.0]])
    shown = np.array([[1.0, 0.0]])
    try:
        covariance = solve_discrete_are(transition.T, shown.T, process, np.eye(1))
    except np.linalg.LinAlgError:
        allowed = f'a higher value: with so little process noise this model has no filter at T = {sample_time!r} s'
        raise ParameterError('observer.bandwidth', parameters.bandwidth, allowed) from None
    gains = covariance[:, 0] / (covariance[0, 0] + 1.0)
    return FilterMatrices(transition, response, np.array([_rounded(gain) for gain in gains]))


def _rounded(value: float) -> float:
    return float(f'{value:.{DIGITS - 1}e}') if math.isfinite(value) else value
