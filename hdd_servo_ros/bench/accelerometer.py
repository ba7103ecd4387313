"""Pair of accelerometers on the base of the drive, with ADC."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import converter_codes
from hdd_servo_ros.bench.instrument_output import OUTPUT, OVERRANGE, read_output
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.numerics.transition import held_input_transition
from hdd_servo_ros.parameters import ParameterSet, parameter

Array = NDArray[np.float64]
AccelerometerArrays = tuple[Array, Array, Array, Array]
"""Constants, state transition of a sensor over a sample, state, motion of the two sensors."""

OUTPUTS = ('x', 'y')
_STREAM = 2
"""Noise stream; differs from the streams of the vibrometer and its drop-outs, because seeds are often equal."""

ACCELEROMETER = layout('lever', 'parasitic', 'gain_x', 'gain_y', 'offset', 'noise', 'seed', 'delay', ('output', OUTPUT))
"""Lever arm [m]; parasitic gain [m/s^2/V]; gain of each sensor [V per m/s^2]; offset, noise [V]; delay [samples]."""

ACCELEROMETER_STATE = layout(('x', OVERRANGE), ('y', OVERRANGE), 'x_held', 'y_held')

_STATES = 4
"""Deflection and rate of the beam, output and rate of the low-pass filter; rates are divided by natural frequency."""


@dataclasses.dataclass(frozen=True)
class AccelerometerParameters(ParameterSet):
    """Parameters of :class:`Accelerometer`."""

    sensitivity: float = parameter(
        0.1, 'sensitivity according to the data sheet', unit='V s^2/m', above=0.0, read_only=True
    )
    separation: float = parameter(
        0.1,
        'distance d between the two sensors; each is at d/2 from the pivot axis',
        unit='m',
        above=0.0,
        read_only=True,
    )
    bandwidth: float = parameter(
        1000.0, 'natural frequency of the two-pole low-pass filter', unit='Hz', above=0.0, maximum=1e6
    )
    damping_ratio: float = parameter(0.707, 'damping ratio of the low-pass filter', above=0.0, maximum=10.0)
    beam_frequency: float = parameter(
        0.0,
        'resonance frequency of the sensing beam, before the low-pass filter; 0 for no resonance',
        unit='Hz',
        minimum=0.0,
        maximum=1e6,
    )
    beam_damping_ratio: float = parameter(0.02, 'damping ratio of the sensing beam resonance', above=0.0, maximum=10.0)
    gain_error: float = parameter(
        0.0, 'relative error of both gains; 0.125 reads 12.5 % too much', minimum=-1.0, maximum=1.0
    )
    gain_mismatch: float = parameter(
        0.0,
        'relative difference between the gains: half is added to x and half subtracted from y',
        minimum=-1.0,
        maximum=1.0,
    )
    offset: float = parameter(0.0, 'output offset of both sensors', unit='V')
    noise: float = parameter(0.0125, 'rms white noise of each sensor per sample', unit='m/s^2', minimum=0.0)
    seed: int = parameter(1, 'seed of the noise', minimum=0, maximum=2**53)
    parasitic_gain: float = parameter(
        0.0,
        'acceleration at a sensor per volt of control, due to the actuator reaction: added to x, subtracted from y',
        unit='m/s^2/V',
    )
    delay: int = parameter(0, 'delay of both outputs', unit='samples', minimum=0, maximum=1)
    output_range: float = parameter(
        10.0, 'saturation limit of each output, -output_range to +output_range; 0 for no limit', unit='V', minimum=0.0
    )
    adc_bits: int = parameter(16, 'ADC resolution; 0 for an ideal ADC', unit='bit', minimum=0, maximum=32)
    adc_range: float = parameter(10.0, 'ADC input range, -adc_range to +adc_range', unit='V', above=0.0)


@compiled_apart
def accelerometer_step(
    constants: Array,
    transition: Array,
    state: Array,
    motion: Array,
    tick: int,
    linear: float,
    angular: float,
    control: float,
) -> tuple[float, float]:
    """Return the outputs x and y at ``tick`` [V]; see :meth:`Accelerometer.step`."""
    c = record(constants, ACCELEROMETER)
    s = record(state, ACCELEROMETER_STATE)
    difference = c.lever * angular + c.parasitic * control
    _move(transition, motion, 0, linear + difference)
    _move(transition, motion, 1, linear - difference)
    deviate_x, deviate_y = normal_pair(np.int64(c.seed), _STREAM, tick)
    x = read_output(c.output, s.x, tick, c.gain_x * motion[0, 2] + c.offset + c.noise * deviate_x)
    y = read_output(c.output, s.y, tick, c.gain_y * motion[1, 2] + c.offset + c.noise * deviate_y)
    output_x, output_y = x, y
    if c.delay > 0.0:
        output_x, output_y = s.x_held, s.y_held
    s.x_held, s.y_held = x, y
    return output_x, output_y


@compiled
def _move(transition: Array, motion: Array, sensor: int, acceleration: float) -> None:
    """Advance a sensor by one sample at a constant acceleration [m/s^2]."""
    q0, q1, q2, q3 = motion[sensor, 0], motion[sensor, 1], motion[sensor, 2], motion[sensor, 3]
    for i in range(_STATES):
        motion[sensor, i] = (
            transition[i, 0] * q0
            + transition[i, 1] * q1
            + transition[i, 2] * q2
            + transition[i, 3] * q3
            + transition[i, 4] * acceleration
        )


class Accelerometer:
    """
    Pair of linear accelerometers on the base, whose difference measures the rotation.

    The sensors are mounted along the arm on both sides of the pivot axis, and both sense across the arm: x measures
    a + alpha d/2, y measures a - alpha d/2, with linear acceleration a, angular acceleration alpha and distance d. The
    actuator reaction on the base is a parasitic path from control to sensor, and acts like a rotation.

    Each reading passes the resonance of the sensing beam (optional) and a two-pole low-pass filter. Both are exact for
    an acceleration that is held over a sample, as in the drive model. Gain, offset, noise, output range and ADC follow.
    The noise of a tick is a function of the seed and the tick only.

    Parameters
    ----------
    parameters
        Parameters of the sensors and the ADC.
    sample_time
        T [s].

    Notes
    -----
    Source: a model of this package; ``docs/instruments/accelerometer.md`` describes it.

    Examples
    --------
    A rotation of 100 rad/s^2 reads with opposite signs at the two sensors, 0.1 m apart:

    >>> from hdd_servo_ros.bench import Accelerometer, AccelerometerParameters
    >>> sensor = Accelerometer(AccelerometerParameters(noise=0.0), sample_time=1e-4)
    >>> for tick in range(100):
    ...     x, y = sensor.step(tick, 0.0, 100.0, 0.0)
    >>> round(x, 4), round(y, 4)  # V
    (0.4999, -0.4999)
    """

    def __init__(self, parameters: AccelerometerParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state = zeros(ACCELEROMETER_STATE)
        self.motion: Array = np.zeros((len(OUTPUTS), _STATES))
        self.update(parameters)

    def update(self, parameters: AccelerometerParameters) -> None:
        """Change the parameters from the next tick on; the counts and the motion of the sensors continue."""
        self.parameters = parameters
        constants = zeros(ACCELEROMETER)
        c = record(constants, ACCELEROMETER)
        c.lever = 0.5 * parameters.separation
        c.parasitic = parameters.parasitic_gain
        c.gain_x = parameters.sensitivity * (1.0 + parameters.gain_error + 0.5 * parameters.gain_mismatch)
        c.gain_y = parameters.sensitivity * (1.0 + parameters.gain_error - 0.5 * parameters.gain_mismatch)
        c.offset = parameters.offset
        c.noise = parameters.noise * parameters.sensitivity
        c.seed = float(parameters.seed)
        c.delay = float(parameters.delay)
        c.output.range = parameters.output_range
        c.output.step, c.output.lowest, c.output.highest = converter_codes(parameters.adc_bits, parameters.adc_range)
        self.arrays: AccelerometerArrays = (
            constants,
            _transition(parameters, self.sample_time),
            self.state,
            self.motion,
        )

    @property
    def saturated_samples(self) -> dict[str, int]:
        """Number of samples of each output clipped so far, by the output range or by the ADC."""
        state = record(self.state, ACCELEROMETER_STATE)
        return {name: int(state[name].samples) for name in OUTPUTS}

    @property
    def largest_output(self) -> float:
        """Largest magnitude of an unsaturated output [V]."""
        p = self.parameters
        step, _, highest = converter_codes(p.adc_bits, p.adc_range)
        converter_limit = step * highest if p.adc_bits else math.inf
        return min(converter_limit, p.output_range or math.inf)

    def saturation_warnings(self) -> dict[str, str]:
        """Return a warning for each output that was clipped, by name."""
        state = record(self.state, ACCELEROMETER_STATE)
        volts = self.largest_output
        return {
            name: f'output {name} saturates at tick {int(state[name].first_tick)}: the limit is {volts:g} V, '
            f'{volts / self.parameters.sensitivity:g} m/s^2; further samples are counted, not logged'
            for name in OUTPUTS
            if state[name].samples
        }

    def step(self, tick: int, linear: float, angular: float, control: float) -> tuple[float, float]:
        """
        Return the outputs x and y at a tick [V].

        Parameters
        ----------
        tick
            Tick k.
        linear, angular
            Acceleration of the base across the arm [m/s^2] and about the pivot axis [rad/s^2], held since the previous
            tick.
        control
            Drive voltage held since the previous tick [V].
        """
        return accelerometer_step(*self.arrays, tick, linear, angular, control)


def _transition(parameters: AccelerometerParameters, sample_time: float) -> Array:
    """Return the state transition of a sensor over a sample, shape (4, 5); the last column is for the acceleration."""
    low_pass = TWO_PI * parameters.bandwidth
    beam = TWO_PI * parameters.beam_frequency
    has_beam = float(beam > 0.0)
    dynamics = [
        [0.0, beam, 0.0, 0.0],
        [-beam, -2.0 * parameters.beam_damping_ratio * beam, 0.0, 0.0],
        [0.0, 0.0, 0.0, low_pass],
        [has_beam * low_pass, 0.0, -low_pass, -2.0 * parameters.damping_ratio * low_pass],
    ]
    inputs = [0.0, beam, 0.0, (1.0 - has_beam) * low_pass]
    transition, response = held_input_transition(dynamics, inputs, sample_time)
    return np.array([[*row, gain] for row, gain in zip(transition, response, strict=True)])
