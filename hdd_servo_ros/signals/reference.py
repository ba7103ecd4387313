"""The reference: desired head position x_d with its analytic first and second derivative."""

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
    """The waveforms by the number that compiled code knows them by."""

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
"""Constants; amplitude [um], frequency [Hz] and phase [turn] of the components of a multisine; seeks."""

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
"""Turns by which an edge may lie late and still be taken at its own tick: far below one tick, far above rounding."""


@dataclasses.dataclass(frozen=True)
class ReferenceParameters(ParameterSet):
    """
    Parameters of :class:`Reference`.

    Lengths are um here, as in chapter 5; a parameter file in other units (section 4.4: m) says so, the arithmetic is
    the same.
    """

    waveform: str = parameter('sine', 'form of the reference x_d(t)', choices=WAVEFORMS)
    amplitude: float = parameter(
        2.0, 'amplitude of sine, square and chirp, height of the step, common factor of a multisine', unit='um'
    )
    frequency: float = parameter(
        100.0,
        'frequency of sine and square, first frequency of the chirp, common factor of a multisine. The thesis writes '
        'A sin(pi f t) and calls f the frequency: this is A sin(2 pi f t); half the value gives the literal reading',
        unit='Hz',
        minimum=0.0,
    )
    phase: float = parameter(0.0, 'phase at start_time, in turns: 0.25 makes a cosine of the sine', unit='turn')
    offset: float = parameter(0.0, 'added to every waveform, and the value before start_time', unit='um')
    start_time: float = parameter(0.0, 'time at which the waveform starts', unit='s', minimum=0.0)
    duty_cycle: float = parameter(
        0.5, 'fraction of its period for which a square stands at +amplitude', above=0.0, maximum=1.0
    )
    slope: float = parameter(100.0, 'slope of the ramp, which holds once it has risen by amplitude', unit='um/s')
    end_frequency: float = parameter(
        1000.0, 'frequency of the chirp after sweep_time, then held', unit='Hz', minimum=0.0
    )
    sweep_time: float = parameter(1.0, 'duration of the sweep of a chirp', unit='s', above=0.0)
    sweep: str = parameter('linear', 'how the frequency of a chirp grows with time', choices=SWEEPS)
    component_amplitudes: tuple[float, ...] = parameter(
        (1.0,), 'amplitudes of the components of a multisine, relative to amplitude'
    )
    component_frequencies: tuple[float, ...] = parameter(
        (1.0,), 'frequencies of the components of a multisine, relative to frequency', minimum=0.0
    )
    component_phases: tuple[float, ...] = parameter(
        (0.0,), 'phases of the components of a multisine, added to phase', unit='turn'
    )
    seek: SeekParameters = group(SeekParameters)

    def check_together(self) -> None:
        """Check the rules that tie several parameters together; raises :class:`ParameterError`."""
        count = len(self.component_amplitudes)
        for name in ('component_frequencies', 'component_phases'):
            value = getattr(self, name)
            if len(value) != count:
                raise ParameterError(name, value, f'as many elements as component_amplitudes, which has {count}')
        if self.waveform == 'chirp' and self.sweep == 'logarithmic' and not self.frequency * self.end_frequency > 0.0:
            name = 'frequency' if self.frequency == 0.0 else 'end_frequency'
            raise ParameterError(name, getattr(self, name), 'above 0 Hz for a logarithmic sweep')
        if self.waveform == 'ramp' and self.slope == 0.0:
            raise ParameterError('slope', self.slope, 'not 0 for a ramp')
        if self.waveform == 'seek':
            check_dwell_times(self.seek)


@compiled
def _chirp(c: np.record, t: float) -> tuple[float, float, float]:
    """Return phase [turn] without the initial one, frequency [Hz] and its rate [Hz/s] at ``t`` s after the start."""
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
    """Return a sine and its derivatives for a phase [turn], a frequency [Hz] and the frequency's slope [Hz/s]."""
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
    """Return x_d [um], its first [um/s] and its second derivative [um/s^2] at ``tick``; see :class:`Reference`."""
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
    The reference generator: x_d(t) and its derivatives at the ticks.

    The derivatives are analytic. Those of a square and a step are zero everywhere: the impulses at the edges cannot be
    sampled, and a controller that is to be fed them would need a smooth reference instead, as seeks along a trajectory
    are. Before ``start_time`` the reference is ``offset`` at rest.

    Parameters
    ----------
    parameters
        Waveform and its numbers.
    sample_time
        T [s].

    Notes
    -----
    Source: thesis sections 4.4 and 5.5; seeks as in ``docs/howto/seek-reference.md``.

    Examples
    --------
    Position [um], velocity [um/s] and acceleration [um/s^2] of a 100 Hz sine of 2 um at 2.5 ms, its first crest:

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
        """Take other parameters from the next tick on; the time axis goes on."""
        self.parameters = parameters
        constants = zeros(REFERENCE)
        c = record(constants, REFERENCE)
        c.time_step = self.sample_time
        c.waveform = WAVEFORMS.index(parameters.waveform)
        # The first tick at or after start_time; a quotient that only rounding lifts above a whole number counts as it.
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
        """The seeks of the waveform ``seek``, known ahead; an empty list with the other waveforms."""
        return self._seeks

    @staticmethod
    def _components(parameters: ReferenceParameters) -> NDArray[np.float64]:
        """Return amplitude [um], frequency [Hz] and phase [turn] of the components of a multisine, a row per each."""
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
