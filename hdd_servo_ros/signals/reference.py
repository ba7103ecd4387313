"""Reference generator: desired head position x_d with its analytic first and second derivatives."""

import dataclasses
import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter
from hdd_servo_ros.signals.seek_parameters import SeekParameters
from hdd_servo_ros.signals.seek_plan import NO_SEEKS, SeekList, check_dwell_times, no_seek_rows, plan, seek_step


class Waveform(IntEnum):
    """Waveforms, numbered for compiled code."""

    SINE = 0
    SQUARE = 1
    STEP = 2
    RAMP = 3
    CHIRP = 4
    MULTISINE = 5
    CONSTANT = 6
    SEEK = 7


WAVEFORMS = tuple(waveform.name.lower() for waveform in Waveform)
SWEEPS = ('linear', 'logarithmic')

ReferenceArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Constants; amplitude [um], frequency [Hz] and phase [turn] of the multisine components; seeks."""

REFERENCE = layout(
    'time_step',
    'waveform',
    'start_tick',
    'start_time',
    'offset',
    'amplitude',
    'frequency',
    'phase',
    'duty_cycle',
    'slope',
    'stop_value',
    'end_frequency',
    'sweep_time',
    'is_logarithmic',
    'sweep_rate',
    'repeat_ticks',
)

EDGE_TOLERANCE = 1e-9
"""Tolerance of an edge with respect to a tick [turns]: far below one tick, far above rounding errors."""


@dataclasses.dataclass(frozen=True)
class ReferenceParameters(ParameterSet):
    """
    Parameters of :class:`Reference`.

    Lengths are in µm, as in thesis chapter 5. A parameter file may use another unit (section 4.4: m) if it declares it;
    the arithmetic is the same.
    """

    waveform: str = parameter('sine', 'waveform of the reference x_d(t)', choices=WAVEFORMS)
    amplitude: float = parameter(
        2.0,
        'amplitude of sine, square and chirp; height of the step and of the ramp; common factor of the multisine',
        unit='um',
    )
    frequency: float = parameter(
        100.0,
        'frequency f of sine and square in A sin(2 pi f t), start frequency of the chirp, common factor of the '
        'multisine; the thesis writes A sin(pi f t): halve the value for its literal reading',
        unit='Hz',
        minimum=0.0,
    )
    phase: float = parameter(0.0, 'phase at start_time; 0.25 turn makes the sine a cosine', unit='turn')
    offset: float = parameter(0.0, 'offset added to every waveform; value before start_time', unit='um')
    start_time: float = parameter(0.0, 'start time of the waveform', unit='s', minimum=0.0)
    duty_cycle: float = parameter(
        0.5, 'duty cycle of the square wave: fraction of the period spent at +amplitude', above=0.0, maximum=1.0
    )
    slope: float = parameter(
        100.0, 'slope of the ramp; the ramp holds its value once it has covered amplitude', unit='um/s'
    )
    end_frequency: float = parameter(
        1000.0, 'end frequency of the chirp, reached after sweep_time and then held', unit='Hz', minimum=0.0
    )
    sweep_time: float = parameter(1.0, 'duration of the frequency sweep of the chirp', unit='s', above=0.0)
    sweep: str = parameter('linear', 'frequency of the chirp as a function of time', choices=SWEEPS)
    component_amplitudes: tuple[float, ...] = parameter(
        (1.0,), 'amplitudes of the multisine components, relative to amplitude'
    )
    component_frequencies: tuple[float, ...] = parameter(
        (1.0,), 'frequencies of the multisine components, relative to frequency', minimum=0.0
    )
    component_phases: tuple[float, ...] = parameter(
        (0.0,), 'phases of the multisine components, added to phase', unit='turn'
    )
    seek: SeekParameters = group(SeekParameters)

    def check_together(self) -> None:
        """Check the combinations of parameters; raise :class:`ParameterError` if one is invalid."""
        count = len(self.component_amplitudes)
        for name in ('component_frequencies', 'component_phases'):
            value = getattr(self, name)
            if len(value) != count:
                raise ParameterError(name, value, f'{count} elements, as many as component_amplitudes')
        if self.waveform == 'chirp' and self.sweep == 'logarithmic' and not self.frequency * self.end_frequency > 0.0:
            name = 'frequency' if self.frequency == 0.0 else 'end_frequency'
            raise ParameterError(name, getattr(self, name), 'above 0 Hz for a logarithmic sweep')
        if self.waveform == 'ramp' and self.slope == 0.0:
            raise ParameterError('slope', self.slope, 'a value other than 0 for a ramp')
        if self.waveform == 'seek':
            check_dwell_times(self.seek)


@compiled
def _chirp(c: np.record, t: float) -> tuple[float, float, float]:
    """Return phase without the initial phase [turn], frequency [Hz] and its rate [Hz/s] at ``t`` [s] from the start."""
    first = c.frequency
    last = c.end_frequency
    rate = c.sweep_rate
    inside = min(t, c.sweep_time)
    if c.is_logarithmic != 0.0 and rate != 0.0:
        growth = exp(rate * inside)
        turns = first * (growth - 1.0) / rate
        frequency = first * growth
        slope = rate * frequency
    else:
        turns = (first + 0.5 * rate * inside) * inside
        frequency = first + rate * inside
        slope = rate
    if t < c.sweep_time:
        return turns, frequency, slope
    return turns + last * (t - inside), last, 0.0


@compiled
def _sine(amplitude: float, turns: float, frequency: float, slope: float) -> tuple[float, float, float]:
    """Return a sine and its derivatives for a phase [turn], a frequency [Hz] and the frequency rate [Hz/s]."""
    sine, cosine = sine_cosine_of_turns(turns)
    w = TWO_PI * frequency
    return (
        amplitude * sine,
        amplitude * w * cosine,
        amplitude * (TWO_PI * slope * cosine - w * w * sine),
    )


@compiled
def reference_step(
    constants: NDArray[np.float64], components: NDArray[np.float64], seeks: NDArray[np.float64], tick: int
) -> tuple[float, float, float]:
    """Return x_d [um] and its first [um/s] and second [um/s^2] derivatives at ``tick``; see :class:`Reference`."""
    c = record(constants, REFERENCE)
    offset = c.offset
    amplitude = c.amplitude
    waveform = int(c.waveform)
    if waveform == Waveform.CONSTANT or float(tick) < c.start_tick:
        return offset, 0.0, 0.0
    if waveform == Waveform.SEEK:
        return seek_step(seeks, int(c.repeat_ticks), tick - int(c.start_tick), c.time_step)
    t = float(tick) * c.time_step - c.start_time
    if waveform == Waveform.STEP:
        return offset + amplitude, 0.0, 0.0
    if waveform == Waveform.RAMP:
        position = c.slope * t
        if abs(position) < abs(c.stop_value):
            return offset + position, c.slope, 0.0
        return offset + c.stop_value, 0.0, 0.0
    if waveform == Waveform.SQUARE:
        turns = c.frequency * t + c.phase + EDGE_TOLERANCE
        if turns - np.floor(turns) < c.duty_cycle:
            return offset + amplitude, 0.0, 0.0
        return offset - amplitude, 0.0, 0.0
    if waveform == Waveform.CHIRP:
        turns, frequency, slope = _chirp(c, t)
        position, velocity, acceleration = _sine(amplitude, turns + c.phase, frequency, slope)
        return offset + position, velocity, acceleration
    if waveform == Waveform.MULTISINE:
        position, velocity, acceleration = offset, 0.0, 0.0
        for i in range(len(components)):
            component_amplitude, frequency, phase = components[i, 0], components[i, 1], components[i, 2]
            x, v, a = _sine(component_amplitude, frequency * t + phase, frequency, 0.0)
            position += x
            velocity += v
            acceleration += a
        return position, velocity, acceleration
    frequency = c.frequency
    position, velocity, acceleration = _sine(amplitude, frequency * t + c.phase, frequency, 0.0)
    return offset + position, velocity, acceleration


class Reference:
    """
    Reference generator: x_d(t) and its derivatives at the ticks.

    The derivatives are analytic. The derivatives of a square wave and a step are zero everywhere, because the impulses
    at the edges cannot be sampled. A controller that needs them requires a smooth reference, such as a seek trajectory.
    Before ``start_time`` the reference is ``offset`` at rest.

    Parameters
    ----------
    parameters
        Parameters of the waveform.
    sample_time
        T [s].

    Notes
    -----
    Source: thesis sections 4.4 and 5.5; ``docs/howto/seek-reference.md`` for seeks.

    Examples
    --------
    Position [um], velocity [um/s] and acceleration [um/s^2] of a 100 Hz sine of 2 µm at 2.5 ms, its first maximum:

    >>> from hdd_servo_ros.signals import Reference, ReferenceParameters
    >>> reference = Reference(ReferenceParameters(amplitude=2.0, frequency=100.0), sample_time=1e-4)
    >>> position, velocity, acceleration = reference.step(25)
    >>> position, round(velocity, 9) + 0.0, round(acceleration)
    (2.0, 0.0, -789568)
    """

    def __init__(self, parameters: ReferenceParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.update(parameters)

    def update(self, parameters: ReferenceParameters) -> None:
        """Change the parameters from the next tick on; the time axis continues."""
        self.parameters = parameters
        constants = zeros(REFERENCE)
        c = record(constants, REFERENCE)
        c.time_step = self.sample_time
        c.waveform = WAVEFORMS.index(parameters.waveform)
        # First tick at or after start_time; the tolerance absorbs a quotient that rounding lifts above a whole number.
        c.start_tick = math.ceil(parameters.start_time / self.sample_time - EDGE_TOLERANCE)
        c.start_time = parameters.start_time
        c.offset = parameters.offset
        c.amplitude = parameters.amplitude
        c.frequency = parameters.frequency
        c.phase = parameters.phase
        c.duty_cycle = parameters.duty_cycle
        c.slope = parameters.slope
        c.stop_value = math.copysign(parameters.amplitude, parameters.slope)
        c.end_frequency = parameters.end_frequency
        c.sweep_time = parameters.sweep_time
        if parameters.sweep == 'logarithmic' and parameters.waveform == 'chirp':
            c.is_logarithmic = 1.0
            c.sweep_rate = log(parameters.end_frequency / parameters.frequency) / parameters.sweep_time
        else:
            c.sweep_rate = (parameters.end_frequency - parameters.frequency) / parameters.sweep_time
        self._seeks, rows = NO_SEEKS, no_seek_rows()
        if parameters.waveform == 'seek':
            self._seeks, rows = plan(parameters.seek, parameters.offset, int(c.start_tick), self.sample_time)
        c.repeat_ticks = self._seeks.repeat_ticks
        self.arrays: ReferenceArrays = (constants, self._components(parameters), rows)

    @property
    def seeks(self) -> SeekList:
        """Seeks of the waveform ``seek``, known in advance; an empty list for the other waveforms."""
        return self._seeks

    @staticmethod
    def _components(parameters: ReferenceParameters) -> NDArray[np.float64]:
        """Return amplitude [um], frequency [Hz] and phase [turn] of the multisine components, one row per component."""
        return np.column_stack(
            (
                parameters.amplitude * np.array(parameters.component_amplitudes),
                parameters.frequency * np.array(parameters.component_frequencies),
                parameters.phase + np.array(parameters.component_phases),
            )
        )

    def step(self, tick: int) -> tuple[float, float, float]:
        """Return x_d [um], dx_d/dt [um/s] and d2x_d/dt2 [um/s^2] at ``tick``."""
        return reference_step(*self.arrays, tick)
