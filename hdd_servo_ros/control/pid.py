"""Conventional PID controller, the baseline of chapters 4 and 5."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterSet, parameter

PidArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

VELOCITY_SOURCES = ('sensor', 'difference')
# Not 'off', which YAML reads as false.
ANTI_WINDUP = ('clamping', 'back_calculation', 'none')

# Array of constants; flags are 1 for yes.
CONSTANTS = layout(
    'time_step',
    'uses_difference',
    'filters_reference',
    'smoothing',
    'proportional_gain',
    'integral_step',
    'derivative_gain',
    'clamps',
    'calculates_back',
    'tracking',
    'fading',
    'velocity_feedforward',
    'acceleration_feedforward',
    'control_limit',
)

STATE = layout(
    'integral',
    'bump',
    'slope',
    'last_error',
    'last_position',
    'measured_velocity',
    'last_reference_velocity',
    'last_reference_acceleration',
    'started',
)

ESTIMATE_NAMES = ('t', 'e', 'integral', 'derivative')
ESTIMATES = layout(*ESTIMATE_NAMES)


@dataclasses.dataclass(frozen=True)
class PidParameters(ParameterSet):
    """Parameters of :class:`Pid`; ``studies/tune.py`` finds these gains for the drive of chapter 5."""

    proportional_gain: float = parameter(0.627, 'proportional gain k_p', unit='V/um', minimum=0.0)
    integral_gain: float = parameter(61.6, 'integral gain k_i', unit='V/(um s)', minimum=0.0)
    derivative_gain: float = parameter(1.39e-4, 'derivative gain k_d', unit='V s/um', minimum=0.0)
    derivative_bandwidth: float = parameter(
        3170.0, 'corner frequency of the first-order low pass on the derivative; 0 disables it', unit='Hz', minimum=0.0
    )
    velocity_source: str = parameter(
        'sensor',
        'source of de/dt: the velocity output of the sensor, or the difference of two errors over T',
        choices=VELOCITY_SOURCES,
    )
    filter_reference: bool = parameter(
        True,
        'pass the reference through the same difference and low pass as the measurement; false uses the velocity of '
        '/reference unfiltered, so that only the measurement is delayed, which shows the cost of that delay',
        read_only=True,
    )
    anti_windup: str = parameter(
        'clamping',
        'clamping: the integral is frozen while the output is saturated and the error would drive it further; '
        'back_calculation: the excess over the limit discharges the integral; none: the integral winds up',
        choices=ANTI_WINDUP,
    )
    tracking_time: float = parameter(1.0e-3, 'time constant of back calculation', unit='s', above=0.0)
    transfer_time: float = parameter(
        1.0e-2,
        'bumpless-transfer time constant: with k_i = 0, the step in u caused by a gain change decays with it',
        unit='s',
        above=0.0,
    )
    velocity_feedforward: float = parameter(0.0, 'feedforward voltage k_v per reference velocity', unit='V s/um')
    acceleration_feedforward: float = parameter(
        0.0, 'feedforward voltage k_a per reference acceleration', unit='V s^2/um'
    )
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
    c, s = record(constants, CONSTANTS), record(state, STATE)
    position = inputs.position
    dx_d, ddx_d = inputs.desired_velocity, inputs.desired_acceleration
    error = position - inputs.desired_position
    if c.filters_reference != 0.0:
        if c.uses_difference == 0.0:
            slope = inputs.velocity - dx_d
        elif s.started != 0.0:
            slope = (error - s.last_error) / c.time_step
        else:
            slope = 0.0
        if s.started != 0.0:
            slope = s.slope + c.smoothing * (slope - s.slope)
    else:
        velocity = dx_d
        if c.uses_difference == 0.0:
            velocity = inputs.velocity
        elif s.started != 0.0:
            velocity = (position - s.last_position) / c.time_step
        if s.started != 0.0:
            velocity = s.measured_velocity + c.smoothing * (velocity - s.measured_velocity)
        s.measured_velocity = velocity
        slope = velocity - dx_d
    integral = s.integral - c.integral_step * error
    derivative = -c.derivative_gain * slope
    compensation = c.velocity_feedforward * dx_d + c.acceleration_feedforward * ddx_d
    limit = c.control_limit
    feedback = derivative + integral + s.bump - c.proportional_gain * error
    unsaturated = feedback + compensation
    # Clamping undoes the part of the integral's own step that exceeds the limit.
    if c.clamps != 0.0:
        if unsaturated > limit and error < 0.0:
            integral = max(s.integral, integral - (unsaturated - limit))
        elif unsaturated < -limit and error > 0.0:
            integral = min(s.integral, integral - (unsaturated + limit))
        feedback = derivative + integral + s.bump - c.proportional_gain * error
        unsaturated = feedback + compensation
    u = saturated(unsaturated, limit)
    found = record(estimates, ESTIMATES)
    found.t = float(inputs.tick) * c.time_step
    found.e = error
    found.integral = integral
    found.derivative = derivative
    if c.calculates_back != 0.0:
        integral += c.tracking * (u - unsaturated)
    s.integral = integral
    s.bump *= c.fading
    s.slope = slope
    s.last_error = error
    s.last_position = position
    s.last_reference_velocity = dx_d
    s.last_reference_acceleration = ddx_d
    s.started = 1.0
    return u, unsaturated, feedback


class Pid:
    """
    PID controller in parallel form with filtered derivative, anti-windup and feedforward.

    With e = x - x_d, the sign convention of thesis eq. (4.10)::

        u = -(k_p e + k_i int e dt + k_d de/dt) + k_v dx_d/dt + k_a d2x_d/dt2.

    The integral is the sum of T e including the present sample, in volts. The derivative is the sensor's velocity minus
    dx_d/dt, or the difference of errors over T. It passes a first-order low pass that is exact for constant inputs over
    a sample (pole exp(-2 pi f T)). Difference and low pass act on the error, so that the reference passes the same
    filter as the measurement; without ``filter_reference`` they act on the measurement alone.

    Estimates: t [s]; e [um]; integral and derivative parts of u [V].

    Parameters
    ----------
    parameters
        Gains, sources and limits.
    sample_time
        T [s].

    Notes
    -----
    Source: a standard form; the PID controller of thesis section 4.4 is not specified there.

    Examples
    --------
    >>> from hdd_servo_ros.control import ControllerInputs, Pid, PidParameters
    >>> controller = Pid(PidParameters(), sample_time=1e-4)
    >>> inputs = ControllerInputs(
    ...     tick=0,
    ...     position=0.1,
    ...     velocity=50.0,
    ...     displacement_volts=0.0125,
    ...     velocity_volts=0.002,
    ...     desired_position=0.0,
    ...     desired_velocity=0.0,
    ...     desired_acceleration=0.0,
    ... )
    >>> u, unsaturated, feedback = controller.step(inputs)  # V
    >>> round(u, 6)
    -0.070266
    >>> -round(0.627 * 0.1 + 61.6 * 1e-4 * 0.1 + 1.39e-4 * 50.0, 6)  # proportional, integral, derivative
    -0.070266
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: PidParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._output_limit = math.inf
        self.constants = zeros(CONSTANTS)
        self.state = zeros(STATE)
        self.estimates = zeros(ESTIMATES)
        self.arrays: PidArrays = (self.constants, self.state, self.estimates)
        """Array arguments of the kernel, in order: constants, state, estimates."""
        self._apply(parameters)

    def update(self, parameters: PidParameters) -> None:
        """
        Use new parameters from the next tick on, without a bump in u.

        The integral absorbs the change in u that new k_p and k_d would cause at the last error. With a new k_i of zero,
        nothing would ever remove it again: this change and the value of the integral then decay with
        ``transfer_time``. The change caused by new feedforward gains decays in the same way.
        """
        old = self.parameters
        s = record(self.state, STATE)
        difference = (parameters.proportional_gain - old.proportional_gain) * s.last_error
        difference += (parameters.derivative_gain - old.derivative_gain) * s.slope
        if parameters.integral_gain > 0.0:
            s.integral += difference
        else:
            s.bump += s.integral + difference
            s.integral = 0.0
        s.bump -= (parameters.velocity_feedforward - old.velocity_feedforward) * s.last_reference_velocity
        s.bump -= (parameters.acceleration_feedforward - old.acceleration_feedforward) * s.last_reference_acceleration
        self._apply(parameters)

    def limit_output(self, limit: float) -> None:
        """Limit the drive voltage also to +-``limit`` [V], the range of the converter after the controller."""
        self._output_limit = limit
        self._apply(self.parameters)

    def _apply(self, parameters: PidParameters) -> None:
        self.parameters = parameters
        c = record(self.constants, CONSTANTS)
        c.time_step = self.sample_time
        c.uses_difference = parameters.velocity_source == 'difference'
        c.filters_reference = parameters.filter_reference
        c.smoothing = 1.0
        if parameters.derivative_bandwidth > 0.0:
            c.smoothing = 1.0 - exp(-TWO_PI * parameters.derivative_bandwidth * self.sample_time)
        c.proportional_gain = parameters.proportional_gain
        c.integral_step = parameters.integral_gain * self.sample_time
        c.derivative_gain = parameters.derivative_gain
        c.clamps = parameters.anti_windup == 'clamping'
        c.calculates_back = parameters.anti_windup == 'back_calculation'
        c.tracking = 1.0 - exp(-self.sample_time / parameters.tracking_time)
        c.fading = exp(-self.sample_time / parameters.transfer_time)
        c.velocity_feedforward = parameters.velocity_feedforward
        c.acceleration_feedforward = parameters.acceleration_feedforward
        c.control_limit = min(parameters.control_limit, self._output_limit)

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit, and u without feedforward [V]; see :class:`Controller`."""
        return pid_step(*self.arrays, *inputs)
