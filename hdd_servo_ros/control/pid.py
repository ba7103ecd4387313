"""The conventional PID controller, the baseline of chapters 4 and 5."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp
from hdd_servo_ros.parameters import ParameterSet, parameter

PidArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

VELOCITY_SOURCES = ('sensor', 'difference')
SENSOR, DIFFERENCE = range(len(VELOCITY_SOURCES))
# Not 'off', which YAML reads as false.
ANTI_WINDUP = ('clamping', 'back_calculation', 'none')
CLAMPING, BACK_CALCULATION, NONE = range(len(ANTI_WINDUP))

# Where the constants of pid_step stand.
TIME_STEP, VELOCITY_SOURCE, PROPORTIONAL, INTEGRAL_STEP, DERIVATIVE, SMOOTHING = range(6)
WINDUP, TRACKING, CONTROL_LIMIT, VELOCITY_FEEDFORWARD, ACCELERATION_FEEDFORWARD, FILTER_REFERENCE = range(6, 12)
FADING = 12
CONSTANTS = 13

# Where its state stands.
INTEGRAL, FILTERED, LAST_ERROR, STARTED, LAST_POSITION, MEASURED_VELOCITY = range(6)
BUMP, LAST_REFERENCE_VELOCITY, LAST_REFERENCE_ACCELERATION = range(6, 9)
STATES = 9

ESTIMATE_NAMES = ('t', 'e', 'integral', 'derivative')


@dataclasses.dataclass(frozen=True)
class PidParameters(ParameterSet):
    """Parameters of :class:`Pid`; the gains are those of ``studies/tune.py`` for the drive of chapter 5."""

    proportional_gain: float = parameter(0.626, 'proportional gain k_p', unit='V/um', minimum=0.0)
    integral_gain: float = parameter(62.0, 'integral gain k_i', unit='V/(um s)', minimum=0.0)
    derivative_gain: float = parameter(1.39e-4, 'derivative gain k_d', unit='V s/um', minimum=0.0)
    derivative_bandwidth: float = parameter(
        3160.0, 'corner frequency of the first-order low pass on the derivative, 0 for none', unit='Hz', minimum=0.0
    )
    velocity_source: str = parameter(
        'sensor',
        'where de/dt comes from: the velocity output of the sensor, or the difference of two errors over T',
        choices=VELOCITY_SOURCES,
    )
    filter_reference: bool = parameter(
        True,
        'whether the reference goes through the same difference and low pass as the measurement; false takes its given '
        'velocity, so that the filter delays the measurement alone: to show what that costs',
        read_only=True,
    )
    anti_windup: str = parameter(
        'clamping',
        'clamping: the integral rests while the output is limited and the error would drive it further; '
        'back_calculation: the excess over the limit discharges it; none: it winds up',
        choices=ANTI_WINDUP,
    )
    tracking_time: float = parameter(1.0e-3, 'time constant of the back calculation', unit='s', above=0.0)
    transfer_time: float = parameter(
        1.0e-2,
        'time constant with which the step fades that new gains would make in u, where there is no integral to take it',
        unit='s',
        above=0.0,
    )
    velocity_feedforward: float = parameter(0.0, 'voltage per reference velocity', unit='V s/um')
    acceleration_feedforward: float = parameter(0.0, 'voltage per reference acceleration', unit='V s^2/um')
    control_limit: float = parameter(10.0, 'largest magnitude of the drive voltage', unit='V', above=0.0)


@compiled
def pid_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    estimates: NDArray[np.float64],
    *values: Any,
) -> tuple[float, float, float]:
    """Return u, u before the limit and u without feedforward [V]; see :class:`Pid`."""
    inputs = ControllerInputs(*values)
    if not all_finite(inputs):
        return math.nan, math.nan, math.nan
    time_step = constants[TIME_STEP]
    position = inputs.position
    dx_d, ddx_d = inputs.desired_velocity, inputs.desired_acceleration
    error = position - inputs.desired_position
    if constants[FILTER_REFERENCE] != 0.0:
        if constants[VELOCITY_SOURCE] == SENSOR:
            slope = inputs.velocity - dx_d
        elif state[STARTED] != 0.0:
            slope = (error - state[LAST_ERROR]) / time_step
        else:
            slope = 0.0
        if state[STARTED] != 0.0:
            slope = state[FILTERED] + constants[SMOOTHING] * (slope - state[FILTERED])
    else:
        velocity = dx_d
        if constants[VELOCITY_SOURCE] == SENSOR:
            velocity = inputs.velocity
        elif state[STARTED] != 0.0:
            velocity = (position - state[LAST_POSITION]) / time_step
        if state[STARTED] != 0.0:
            velocity = state[MEASURED_VELOCITY] + constants[SMOOTHING] * (velocity - state[MEASURED_VELOCITY])
        state[MEASURED_VELOCITY] = velocity
        slope = velocity - dx_d
    state[LAST_POSITION] = position
    integral = state[INTEGRAL] - constants[INTEGRAL_STEP] * error
    derivative = -constants[DERIVATIVE] * slope
    compensation = constants[VELOCITY_FEEDFORWARD] * dx_d + constants[ACCELERATION_FEEDFORWARD] * ddx_d
    limit = constants[CONTROL_LIMIT]
    feedback = derivative + integral + state[BUMP] - constants[PROPORTIONAL] * error
    unsaturated = feedback + compensation
    # Clamping takes back what the integral's own step does beyond the limit.
    if constants[WINDUP] == CLAMPING:
        if unsaturated > limit and error < 0.0:
            integral = max(state[INTEGRAL], integral - (unsaturated - limit))
        elif unsaturated < -limit and error > 0.0:
            integral = min(state[INTEGRAL], integral - (unsaturated + limit))
        feedback = derivative + integral + state[BUMP] - constants[PROPORTIONAL] * error
        unsaturated = feedback + compensation
    u = saturated(unsaturated, limit)
    estimates[0] = float(inputs.tick) * time_step
    estimates[1] = error
    estimates[2] = integral
    estimates[3] = derivative
    if constants[WINDUP] == BACK_CALCULATION:
        integral += constants[TRACKING] * (u - unsaturated)
    state[INTEGRAL] = integral
    state[BUMP] *= constants[FADING]
    state[LAST_REFERENCE_VELOCITY] = dx_d
    state[LAST_REFERENCE_ACCELERATION] = ddx_d
    state[FILTERED] = slope
    state[LAST_ERROR] = error
    state[STARTED] = 1.0
    return u, unsaturated, feedback


class Pid:
    """
    PID controller in parallel form with filtered derivative, anti-windup and feedforward.

    With e = x - x_d, the sign of (4.10),

        u = -(k_p e + k_i int e dt + k_d de/dt) + k_v dx_d/dt + k_a d2x_d/dt2.

    The integral is the sum of T e, the present sample included, kept in volts. The derivative is the sensor's velocity
    less dx_d, or the difference of errors over T, behind a first-order low pass that a constant input passes exactly
    as the continuous one (pole exp(-2 pi f T)). Both act on the error, so that the reference goes through the same as
    the measurement; without ``filter_reference`` they act on the measurement alone.

    Estimates: t [s]; e [um]; integral and derivative, the integral's and the derivative's share of u [V].

    Parameters
    ----------
    parameters
        Gains, sources and limits.
    sample_time
        T [s].
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: PidParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._output_limit = math.inf
        self.state: NDArray[np.float64] = np.zeros(STATES)
        self.estimates: NDArray[np.float64] = np.zeros(len(ESTIMATE_NAMES))
        self._take(parameters)

    def update(self, parameters: PidParameters) -> None:
        """
        Take other parameters from the next tick on, without a bump in u.

        The integral takes up the difference that new k_p and k_d would make at the last error. With a new k_i of zero
        nothing would ever take it out of there again: the difference, and what the integral holds, then fade with
        ``transfer_time``. So does the difference that a new feedforward would make.
        """
        old = self.parameters
        difference = (parameters.proportional_gain - old.proportional_gain) * self.state[LAST_ERROR]
        difference += (parameters.derivative_gain - old.derivative_gain) * self.state[FILTERED]
        if parameters.integral_gain > 0.0:
            self.state[INTEGRAL] += difference
        else:
            self.state[BUMP] += self.state[INTEGRAL] + difference
            self.state[INTEGRAL] = 0.0
        velocity, acceleration = self.state[[LAST_REFERENCE_VELOCITY, LAST_REFERENCE_ACCELERATION]]
        self.state[BUMP] -= (parameters.velocity_feedforward - old.velocity_feedforward) * velocity
        self.state[BUMP] -= (parameters.acceleration_feedforward - old.acceleration_feedforward) * acceleration
        self._take(parameters)

    def limit_output(self, limit: float) -> None:
        """Limit the drive voltage to +-``limit`` [V] as well, since no more comes out behind the controller."""
        self._output_limit = limit
        self._take(self.parameters)

    def _take(self, parameters: PidParameters) -> None:
        self.parameters = parameters
        constants = np.zeros(CONSTANTS)
        constants[TIME_STEP] = self.sample_time
        constants[VELOCITY_SOURCE] = VELOCITY_SOURCES.index(parameters.velocity_source)
        constants[FILTER_REFERENCE] = float(parameters.filter_reference)
        constants[PROPORTIONAL] = parameters.proportional_gain
        constants[INTEGRAL_STEP] = parameters.integral_gain * self.sample_time
        constants[DERIVATIVE] = parameters.derivative_gain
        constants[SMOOTHING] = 1.0
        if parameters.derivative_bandwidth > 0.0:
            constants[SMOOTHING] = 1.0 - exp(-TWO_PI * parameters.derivative_bandwidth * self.sample_time)
        constants[WINDUP] = ANTI_WINDUP.index(parameters.anti_windup)
        constants[TRACKING] = 1.0 - exp(-self.sample_time / parameters.tracking_time)
        constants[FADING] = exp(-self.sample_time / parameters.transfer_time)
        constants[CONTROL_LIMIT] = min(parameters.control_limit, self._output_limit)
        constants[VELOCITY_FEEDFORWARD] = parameters.velocity_feedforward
        constants[ACCELERATION_FEEDFORWARD] = parameters.acceleration_feedforward
        self.constants: NDArray[np.float64] = constants

    @property
    def arrays(self) -> PidArrays:
        """The arrays that the kernel takes first: constants, state, estimates."""
        return self.constants, self.state, self.estimates

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit, and u without feedforward [V]; see :class:`Controller`."""
        return pid_step(*self.arrays, *inputs)
