"""Base vibration along or about one axis: band-limited random, swept sine, sine, or a recording."""

import dataclasses
import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.band import band_power, band_sections, filtered
from hdd_servo_ros.disturbance.recording import INTERPOLATIONS, at_ticks
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import exp, log, sine_cosine_of_turns
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter


class Kind(IntEnum):
    """Kinds of vibration, numbered for compiled code."""

    RANDOM = 0
    SWEPT_SINE = 1
    SINE = 2
    RECORDING = 3


KINDS = tuple(kind.name.lower() for kind in Kind)
SWEEPS = ('linear', 'logarithmic')
LEAST_EDGE = 1e-5
"""Lowest edge frequency, relative to the sampling rate; slower filters lose precision and need a long run-in."""
_EDGE_TOLERANCE = 1e-9
"""Tolerance of start_time with respect to a tick [samples]."""
_RMS, _AMPLITUDE = 'rms acceleration of random vibration', 'amplitude of sine and swept sine'

VIBRATION = layout(
    'is_enabled',
    'kind',
    'seed',
    'stream',
    'time_step',
    'start_tick',
    'start_time',
    'random_scale',
    'amplitude',
    'frequency',
    'phase',
    'start_frequency',
    'end_frequency',
    'sweep_time',
    'sweep_rate',
    'sweep_turns',
    'is_logarithmic',
    'is_sweep_repeated',
    'is_recording_repeated',
    'recording_scale',
)


@dataclasses.dataclass(frozen=True)
class VibrationParameters(ParameterSet):
    """Base vibration: linear along the head motion [m/s^2]; also base class of rotational vibration."""

    enabled: bool = parameter(False, 'enable the base vibration on this axis')
    kind: str = parameter('random', 'kind of vibration', choices=KINDS)
    seed: int = parameter(1, 'seed of random vibration', minimum=0, maximum=2**53)
    start_time: float = parameter(0.0, 'start time of the vibration', unit='s', minimum=0.0, maximum=2e9)
    rms: float = parameter(1.0, _RMS, unit='m/s^2', minimum=0.0)
    low: float = parameter(
        10.0,
        'lower edge frequency of random vibration, at half power; 0 for no lower edge',
        unit='Hz',
        minimum=0.0,
    )
    high: float = parameter(
        500.0,
        'upper edge frequency of random vibration, at half power; below half the sampling rate',
        unit='Hz',
        above=0.0,
    )
    low_order: int = parameter(8, 'order of the Butterworth high-pass filter at the lower edge', minimum=1, maximum=32)
    high_order: int = parameter(16, 'order of the Butterworth low-pass filter at the upper edge', minimum=1, maximum=32)
    amplitude: float = parameter(1.0, _AMPLITUDE, unit='m/s^2')
    frequency: float = parameter(100.0, 'frequency of the sine', unit='Hz', minimum=0.0)
    phase: float = parameter(0.0, 'phase of sine and swept sine at start_time', unit='turn')
    start_frequency: float = parameter(5.0, 'start frequency of the swept sine', unit='Hz', minimum=1e-3)
    end_frequency: float = parameter(500.0, 'end frequency of the swept sine', unit='Hz', above=0.0)
    sweep_time: float = parameter(10.0, 'duration of a sweep', unit='s', above=0.0)
    sweep: str = parameter('logarithmic', 'frequency as a function of time in a sweep', choices=SWEEPS)
    sweep_repeated: bool = parameter(
        True, 'repeat the sweep with continuous phase; if false, the sine stays at end_frequency after the sweep'
    )
    recording: str = parameter(
        '', 'CSV file of a recording with time [s] and acceleration; its first row is at start_time', read_only=True
    )
    recording_scale: float = parameter(1.0, 'scale factor of the recorded acceleration')
    recording_interpolation: str = parameter(
        'linear',
        'interpolation between two rows of the recording: linear, or hold the previous row',
        choices=INTERPOLATIONS,
    )
    recording_repeated: bool = parameter(False, 'repeat the recording; if false, the acceleration is 0 after its end')

    def check_together(self) -> None:
        """Reject a lower edge above the upper edge, and kind recording without a file."""
        if not self.low < self.high:
            raise ParameterError('low', self.low, f'below high, which is {self.high!r} [Hz]')
        if self.kind == 'recording' and not self.recording:
            raise ParameterError('recording', '', 'the path of a CSV file, because kind is recording')

    @property
    def band(self) -> tuple[float, float, int, int]:
        """Edge frequencies [Hz] and orders of the band: low, high, order at low, order at high."""
        return self.low, self.high, self.low_order, self.high_order

    @property
    def structure(self) -> tuple[int, int]:
        """Orders of the filter, which determine its number of states."""
        return self.low_order if self.low > 0.0 else 0, self.high_order

    @property
    def is_random(self) -> bool:
        """Whether the vibration is enabled and random, so that the filter is used."""
        return self.enabled and self.kind == 'random'

    def check_rate(self, name: str, sample_time: float) -> None:
        """
        Check the frequencies against the sampling rate.

        Parameters
        ----------
        name
            Name of the parameter group.
        sample_time
            T [s].

        Raises
        ------
        ParameterError
            If a frequency in use is not below half the sampling rate, or an edge of the band is too low for it.
        """
        used = {'random': ('high',), 'sine': ('frequency',), 'swept_sine': ('start_frequency', 'end_frequency')}
        for own in used.get(self.kind, ()) if self.enabled else ():
            frequency = getattr(self, own)
            if not 2.0 * frequency * sample_time < 1.0:
                allowed = f'below half the sampling rate, {0.5 / sample_time:g} Hz'
                raise ParameterError(f'{name}.{own}', frequency, allowed)
        for own, none in (('low', '0, or '), ('high', '')) if self.is_random else ():
            edge = getattr(self, own)
            if 0.0 < edge * sample_time < LEAST_EDGE:
                allowed = f'{none}at least {LEAST_EDGE / sample_time:g} Hz with sample_time = {sample_time!r} s'
                raise ParameterError(f'{name}.{own}', edge, allowed)


@dataclasses.dataclass(frozen=True)
class RotationalVibrationParameters(VibrationParameters):
    """Base vibration: rotational about the pivot axis [rad/s^2]."""

    rms: float = parameter(1.0, _RMS, unit='rad/s^2', minimum=0.0)
    amplitude: float = parameter(1.0, _AMPLITUDE, unit='rad/s^2')


@dataclasses.dataclass(frozen=True)
class BaseVibrationParameters(ParameterSet):
    """Base vibration, rotational and linear."""

    rotational: RotationalVibrationParameters = group(RotationalVibrationParameters)
    linear: VibrationParameters = group(VibrationParameters)


def fill_vibration(c: np.record, parameters: VibrationParameters, stream: int, sample_time: float) -> None:
    """Fill the constants of :func:`vibration_step` at T [s]; ``stream`` is the noise stream."""
    c.is_enabled = float(parameters.enabled)
    c.kind = KINDS.index(parameters.kind)
    c.seed = parameters.seed
    c.stream = stream
    c.time_step = sample_time
    c.start_tick = math.ceil(parameters.start_time / sample_time - _EDGE_TOLERANCE)
    c.start_time = parameters.start_time
    if parameters.is_random:
        c.random_scale = parameters.rms / math.sqrt(band_power(*parameters.band, sample_time))
    c.amplitude = parameters.amplitude
    c.frequency = parameters.frequency
    c.phase = parameters.phase
    first, last, duration = parameters.start_frequency, parameters.end_frequency, parameters.sweep_time
    c.start_frequency, c.end_frequency, c.sweep_time = first, last, duration
    # With equal frequencies the sweep rate is 0; use the linear formula, because the logarithmic one divides by it.
    c.is_logarithmic = float(parameters.sweep == 'logarithmic' and first != last)
    if c.is_logarithmic:
        c.sweep_rate = log(last / first) / duration
        c.sweep_turns = (last - first) / c.sweep_rate
    else:
        c.sweep_rate = (last - first) / duration
        c.sweep_turns = 0.5 * (first + last) * duration
    c.is_sweep_repeated = float(parameters.sweep_repeated)
    c.is_recording_repeated = float(parameters.recording_repeated)
    c.recording_scale = parameters.recording_scale


def sections_of(parameters: VibrationParameters, sample_time: float) -> NDArray[np.float64]:
    """Return the filter sections of the band at T [s]; empty if the vibration is not random."""
    return band_sections(*parameters.band, sample_time) if parameters.is_random else np.zeros((0, 5))


def samples_of(
    parameters: VibrationParameters, recording: NDArray[np.float64] | None, sample_time: float
) -> NDArray[np.float64]:
    """Return the recording at the ticks from start_time on, at T [s]; empty if the vibration is not a recording."""
    if recording is None or not parameters.enabled or parameters.kind != 'recording':
        return np.zeros(0)
    return at_ticks(recording, parameters.recording_interpolation, sample_time)


@compiled
def _swept_turns(c: np.record, t: float) -> float:
    """Return the phase of the swept sine at a time ``t`` [s] after its start [turn]."""
    duration = c.sweep_time
    turns: float = 0.0
    if c.is_sweep_repeated != 0.0:
        sweeps = np.floor(t / duration)
        turns = sweeps * c.sweep_turns
        t -= sweeps * duration
    elif t > duration:
        turns = c.end_frequency * (t - duration)
        t = duration
    if c.is_logarithmic != 0.0:
        turns += c.start_frequency * (exp(c.sweep_rate * t) - 1.0) / c.sweep_rate
    else:
        turns += (c.start_frequency + 0.5 * c.sweep_rate * t) * t
    return turns


@compiled_apart
def vibration_step(
    c: np.record,
    sections: NDArray[np.float64],
    states: NDArray[np.float64],
    samples: NDArray[np.float64],
    tick: int,
) -> float:
    """
    Return the acceleration at a tick [m/s^2 or rad/s^2]; advances the filter of random vibration.

    Parameters
    ----------
    c
        Constants, a record with the layout :data:`VIBRATION`.
    sections, states
        Filter sections of the band, and their states.
    samples
        Resampled recording, one value per tick.
    tick
        Tick of the sample.
    """
    since = tick - int(c.start_tick)
    if since < 0:
        return 0.0
    kind = int(c.kind)
    scale: float = c.amplitude
    if kind == Kind.RANDOM:
        scale = c.random_scale
        value = filtered(sections, states, normal_pair(np.int64(c.seed), np.int64(c.stream), tick)[0])
    elif kind == Kind.RECORDING:
        scale = c.recording_scale
        if c.is_recording_repeated != 0.0:
            since %= len(samples)
        value = samples[since] if since < len(samples) else 0.0
    else:
        t = float(tick) * c.time_step - c.start_time
        turns = c.frequency * t if kind == Kind.SINE else _swept_turns(c, t)
        value = sine_cosine_of_turns(turns + c.phase)[0]
    return scale * value
