"""Laser Doppler vibrometer with ADC."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import converted, converter_codes
from hdd_servo_ros.bench.instrument_output import OUTPUT, OVERRANGE, read_output
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log
from hdd_servo_ros.numerics.noise import fill_normal_pairs, normal_pair, uniform_pair
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterSet, parameter

OUTPUTS = ('displacement', 'velocity')
NOISE_MEASURES = ('rms', 'density')
DROPOUT_EFFECTS = ('hold', 'zero')
LONGEST_DELAY = 1e-3
"""Upper bound of the demodulator delay [s]; sets the length of the motion history."""

LdvArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Constants, state, and motion history of the last ticks."""

LDV = layout(
    'displacement_gain',
    'velocity_gain',
    ('output', OUTPUT),
    'has_noise',
    'displacement_noise',
    'velocity_noise',
    'noise_decay',
    'noise_step',
    'seed',
    'time_step',
    'delay_samples',
    'delay_fraction',
    'filter_decay',
    'filter_last',
    'filter_now',
    'dropout_chance',
    'dropout_samples',
    'is_dropout_zero',
)

LDV_STATE = layout(
    ('displacement', OVERRANGE),
    ('velocity', OVERRANGE),
    'dropped_samples',
    'has_started',
    'displacement_deviate',
    'velocity_deviate',
    'dropout_remaining',
    'position_held',
    'velocity_held',
    'position_input',
    'velocity_input',
    'position_filtered',
    'velocity_filtered',
)

NOISE_STREAM, DROPOUT_STREAM = range(2)
"""Random number streams of the noise and of the drop-outs."""


@dataclasses.dataclass(frozen=True)
class LdvParameters(ParameterSet):
    """Parameters of :class:`Ldv`; defaults as in thesis chapter 5 (8 µm/V) where the thesis gives a value."""

    displacement_scale: float = parameter(
        8.0, 'head displacement per volt of the displacement output', unit='um/V', above=0.0, read_only=True
    )
    velocity_scale: float = parameter(
        5000.0, 'head velocity per volt of the velocity output', unit='um/s/V', above=0.0, read_only=True
    )
    noise: bool = parameter(True, 'enable the noise of both outputs')
    noise_measure: str = parameter(
        'rms',
        'noise specification: rms uses displacement_noise and velocity_noise, density uses the noise densities',
        choices=NOISE_MEASURES,
    )
    displacement_noise: float = parameter(3e-3, 'rms noise of the displacement output', unit='um', minimum=0.0)
    velocity_noise: float = parameter(3.0, 'rms noise of the velocity output', unit='um/s', minimum=0.0)
    displacement_noise_density: float = parameter(
        4.24e-5,
        'one-sided amplitude spectral density of the displacement noise at low frequency',
        unit='um/sqrt(Hz)',
        minimum=0.0,
    )
    velocity_noise_density: float = parameter(
        4.24e-2,
        'one-sided amplitude spectral density of the velocity noise at low frequency',
        unit='um/s/sqrt(Hz)',
        minimum=0.0,
    )
    noise_bandwidth: float = parameter(
        0.0,
        'corner frequency of the first-order low-pass noise filter; 0 for white noise up to half the sampling rate',
        unit='Hz',
        minimum=0.0,
    )
    seed: int = parameter(
        1,
        'seed of noise and drop-outs; the random numbers of a tick depend on seed and tick only',
        minimum=0,
        maximum=2**53,
    )
    demodulator_delay: float = parameter(
        0.0,
        'demodulator delay, not necessarily a whole number of samples',
        unit='s',
        minimum=0.0,
        maximum=LONGEST_DELAY,
    )
    demodulator_bandwidth: float = parameter(
        0.0,
        'corner frequency of the first-order low-pass filter of the demodulator; 0 for no filter',
        unit='Hz',
        minimum=0.0,
    )
    dropout_rate: float = parameter(
        0.0,
        'mean rate of drop-outs (dark speckles) while the signal is present; 0 for no drop-outs',
        unit='1/s',
        minimum=0.0,
    )
    dropout_duration: float = parameter(2e-4, 'mean duration of a drop-out', unit='s', above=0.0)
    dropout_effect: str = parameter(
        'hold',
        'demodulator output during a drop-out: hold the last motion, or zero (0 um, 0 um/s)',
        choices=DROPOUT_EFFECTS,
    )
    output_range: float = parameter(
        10.0, 'saturation limit of each output, -output_range to +output_range; 0 for no limit', unit='V', minimum=0.0
    )
    adc_bits: int = parameter(16, 'ADC resolution; 0 for an ideal ADC', unit='bit', minimum=0, maximum=32)
    adc_range: float = parameter(10.0, 'ADC input range, -adc_range to +adc_range', unit='V', above=0.0)

    def levels(self) -> tuple[float, float]:
        """Return the lowest and the highest possible output voltage [V]; infinities without a limit."""
        step, lowest, highest = converter_codes(self.adc_bits, self.adc_range)
        reach = self.output_range if self.output_range > 0.0 else math.inf
        if step == 0.0:
            return -reach, reach
        # Rounding may move the end of the range to the next code.
        ends = [converted(volts, step, lowest, highest) for volts in (-reach, reach)]
        return ends[0], ends[1]


@compiled
def _start(s: np.record, history: NDArray[np.float64], position: float, velocity: float) -> None:
    """Initialize the history and the filters with the first motion, at rest before it."""
    for i in range(len(history)):
        history[i, 0], history[i, 1] = position, 0.0
    s.position_held, s.velocity_held = position, velocity
    s.position_input, s.velocity_input = position, velocity
    s.position_filtered, s.velocity_filtered = position, velocity


@compiled
def _delayed(
    c: np.record, history: NDArray[np.float64], tick: int, position: float, velocity: float
) -> tuple[float, float]:
    """
    Return position and velocity delayed by the demodulator delay.

    Between two samples the motion is interpolated by the cubic Hermite polynomial of their positions and velocities.
    """
    kept = len(history)
    history[tick % kept, 0], history[tick % kept, 1] = position, velocity
    samples, fraction = int(c.delay_samples), c.delay_fraction
    if samples == 0 and fraction == 0.0:
        return position, velocity
    after = (tick - samples + kept) % kept
    x1, v1 = history[after, 0], history[after, 1]
    if fraction == 0.0:
        return x1, v1
    before = (after - 1 + kept) % kept
    x0, v0 = history[before, 0], history[before, 1]
    time_step = c.time_step
    s = 1.0 - fraction
    rise = x1 - x0
    x = x0 + s * s * (3.0 - 2.0 * s) * rise + time_step * s * fraction * (fraction * v0 - s * v1)
    v = 6.0 * s * fraction * rise / time_step + (1.0 - 3.0 * s) * fraction * v0 + s * (3.0 * s - 2.0) * v1
    return x, v


@compiled
def _with_dropouts(c: np.record, s: np.record, tick: int, position: float, velocity: float) -> tuple[float, float]:
    """Return the motion, or the substitute of the demodulator during a drop-out."""
    if c.dropout_chance > 0.0:
        if s.dropout_remaining < 1.0:
            start, length = uniform_pair(np.int64(c.seed), DROPOUT_STREAM, tick)
            if start < c.dropout_chance:
                s.dropout_remaining = np.ceil(-log(length) * c.dropout_samples)
        if s.dropout_remaining >= 1.0:
            s.dropout_remaining -= 1.0
            s.dropped_samples += 1.0
            if c.is_dropout_zero != 0.0:
                return 0.0, 0.0
            return s.position_held, s.velocity_held
    s.position_held = position
    s.velocity_held = velocity
    return position, velocity


@compiled
def _filtered(c: np.record, s: np.record, position: float, velocity: float) -> tuple[float, float]:
    """Return the motion after the demodulator low-pass filter, exact for an input that is linear between samples."""
    decay, last, now = c.filter_decay, c.filter_last, c.filter_now
    if decay > 0.0:
        x = decay * s.position_filtered + last * s.position_input + now * position
        v = decay * s.velocity_filtered + last * s.velocity_input + now * velocity
    else:
        x, v = position, velocity
    s.position_input, s.velocity_input = position, velocity
    s.position_filtered, s.velocity_filtered = x, v
    return x, v


@compiled
def fill_ldv_deviates(constants: NDArray[np.float64], first_tick: int, deviates: NDArray[np.float64]) -> None:
    """
    Write the standard normal deviates of the noise at consecutive ticks, for :func:`ldv_output`.

    Parameters
    ----------
    constants
        Array with the layout ``LDV``.
    first_tick
        First tick.
    deviates
        Output array, shape (2 n,): the deviates of the displacement and the velocity output of each tick, interleaved.
        Unchanged if the noise is disabled.
    """
    c = record(constants, LDV)
    if c.has_noise != 0.0:
        fill_normal_pairs(np.int64(c.seed), NOISE_STREAM, first_tick, deviates)


@compiled
def ldv_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    history: NDArray[np.float64],
    tick: int,
    head_position: float,
    head_velocity: float,
) -> tuple[float, float]:
    """Return displacement and velocity output at ``tick`` [V]; see :class:`Ldv`."""
    c = record(constants, LDV)
    deviate_0, deviate_1 = 0.0, 0.0
    if c.has_noise != 0.0:
        deviate_0, deviate_1 = normal_pair(np.int64(c.seed), NOISE_STREAM, tick)
    return ldv_output(constants, state, history, tick, head_position, head_velocity, deviate_0, deviate_1)


@compiled
def ldv_output(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    history: NDArray[np.float64],
    tick: int,
    head_position: float,
    head_velocity: float,
    deviate_0: float,
    deviate_1: float,
) -> tuple[float, float]:
    """Return the result of :func:`ldv_step` for given noise deviates of ``tick``; see :func:`fill_ldv_deviates`."""
    c = record(constants, LDV)
    s = record(state, LDV_STATE)
    first = s.has_started == 0.0
    if first:
        _start(s, history, head_position, head_velocity)
        s.has_started = 1.0
    position, velocity = _delayed(c, history, tick, head_position, head_velocity)
    position, velocity = _with_dropouts(c, s, tick, position, velocity)
    position, velocity = _filtered(c, s, position, velocity)
    displacement_volts = position * c.displacement_gain
    velocity_volts = velocity * c.velocity_gain
    if c.has_noise != 0.0:
        if c.noise_decay > 0.0 and not first:
            deviate_0 = c.noise_decay * s.displacement_deviate + c.noise_step * deviate_0
            deviate_1 = c.noise_decay * s.velocity_deviate + c.noise_step * deviate_1
        s.displacement_deviate, s.velocity_deviate = deviate_0, deviate_1
        displacement_volts += c.displacement_noise * deviate_0
        velocity_volts += c.velocity_noise * deviate_1
    return (
        read_output(c.output, s.displacement, tick, displacement_volts),
        read_output(c.output, s.velocity, tick, velocity_volts),
    )


class Ldv:
    """
    Laser Doppler vibrometer of thesis chapter 5, with ADC.

    The head motion passes the demodulator (delay, drop-outs, first-order low-pass filter). Each output is the result
    divided by its scale, plus noise, clipped to the output range and rounded to the ADC step. Each effect can be
    disabled separately. ``docs/instruments/ldv.md`` describes the models and their effect on the error.

    With ``noise_bandwidth`` = 0 the noise is one deviate per sample: white up to half the sampling rate, with the given
    rms value or, for a density D, with the rms value D sqrt(1/(2T)). With a bandwidth f it is sampled first-order
    low-pass noise: an autoregressive process with the pole exp(-2 pi f T), which has the autocovariance of the sampled
    process, including aliasing. Its rms value is the given one, or D sqrt(pi f/2).

    The random numbers of a tick are a function of the seed and the tick only. Non-finite values pass through, so that
    a diverged run remains visible.

    Parameters
    ----------
    parameters
        Scales, demodulator, noise, output range and ADC.
    sample_time
        T [s].

    Attributes
    ----------
    state
        Counts and first ticks of saturation, drop-outs, and the states of filters and noise.
    history
        Position and velocity of the last ticks, long enough for the largest delay; tick k is in row k modulo its
        length.

    Notes
    -----
    Source: thesis section 5.2 for the 8 µm/V; the demodulator and the noise are models of this package.

    Examples
    --------
    >>> from hdd_servo_ros.bench import Ldv, LdvParameters
    >>> ldv = Ldv(LdvParameters(), sample_time=1e-4)
    >>> displacement, velocity = ldv.step(0, 2.0, 100.0)  # V, for a head at 2 um and 100 um/s
    >>> round(displacement, 5), round(velocity, 5)
    (0.25055, 0.02014)
    >>> ldv.saturated_samples
    {'displacement': 0, 'velocity': 0}
    """

    def __init__(self, parameters: LdvParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state = zeros(LDV_STATE)
        self.history: NDArray[np.float64] = np.zeros((math.ceil(LONGEST_DELAY / sample_time) + 2, 2))
        self.update(parameters)

    def update(self, parameters: LdvParameters) -> None:
        """Change the parameters from the next tick on; the counts and all states are kept."""
        self.parameters = parameters
        constants = zeros(LDV)
        c = record(constants, LDV)
        c.displacement_gain = 1.0 / parameters.displacement_scale
        c.velocity_gain = 1.0 / parameters.velocity_scale
        c.output.range = parameters.output_range
        c.output.step, c.output.lowest, c.output.highest = converter_codes(parameters.adc_bits, parameters.adc_range)
        self._fill_noise(c)
        self._fill_demodulator(c)
        self.arrays: LdvArrays = (constants, self.state, self.history)

    def _fill_noise(self, c: np.record) -> None:
        parameters, time_step = self.parameters, self.sample_time
        corner = parameters.noise_bandwidth
        displacement, velocity = parameters.displacement_noise, parameters.velocity_noise
        if parameters.noise_measure == 'density':
            # Noise bandwidth: pi/2 times the corner frequency of the low pass, or half the sampling rate if white.
            bandwidth = 0.25 * TWO_PI * corner if corner > 0.0 else 0.5 / time_step
            displacement = parameters.displacement_noise_density * math.sqrt(bandwidth)
            velocity = parameters.velocity_noise_density * math.sqrt(bandwidth)
        c.has_noise = float(parameters.noise)
        c.displacement_noise = displacement / parameters.displacement_scale
        c.velocity_noise = velocity / parameters.velocity_scale
        if corner > 0.0:
            decay = exp(-TWO_PI * corner * time_step)
            c.noise_decay = decay
            c.noise_step = math.sqrt(1.0 - decay * decay)
        c.seed = float(parameters.seed)

    def _fill_demodulator(self, c: np.record) -> None:
        parameters, time_step = self.parameters, self.sample_time
        c.time_step = time_step
        samples = parameters.demodulator_delay / time_step
        c.delay_samples = math.floor(samples)
        c.delay_fraction = samples - math.floor(samples)
        if parameters.demodulator_bandwidth > 0.0:
            angle = TWO_PI * parameters.demodulator_bandwidth * time_step
            decay = exp(-angle)
            c.filter_decay = decay
            c.filter_last = (1.0 - decay) / angle - decay
            c.filter_now = 1.0 - (1.0 - decay) / angle
        if parameters.dropout_rate > 0.0:
            c.dropout_chance = 1.0 - exp(-parameters.dropout_rate * time_step)
            c.dropout_samples = parameters.dropout_duration / time_step
            c.is_dropout_zero = float(parameters.dropout_effect == 'zero')

    @property
    def saturated_samples(self) -> dict[str, int]:
        """Number of samples of each output clipped so far, by the output range or by the ADC."""
        state = record(self.state, LDV_STATE)
        return {name: int(state[name].samples) for name in OUTPUTS}

    @property
    def first_saturated_tick(self) -> dict[str, int | None]:
        """First tick at which each output was clipped; None if it was not clipped."""
        state = record(self.state, LDV_STATE)
        return {name: int(state[name].first_tick) if state[name].samples else None for name in OUTPUTS}

    @property
    def dropped_samples(self) -> int:
        """Number of samples lost in drop-outs so far."""
        return int(record(self.state, LDV_STATE).dropped_samples)

    def saturation_warnings(self) -> dict[str, str]:
        """Return a warning for each output that was clipped, by name."""
        scales = {
            'displacement': (self.parameters.displacement_scale, 'um'),
            'velocity': (self.parameters.velocity_scale, 'um/s'),
        }
        highest = self.parameters.levels()[1]
        return {
            name: f'the {name} output saturates at tick {tick}: the limit is {highest:g} V, '
            f'{highest * scales[name][0]:g} {scales[name][1]}; further samples are counted, not logged'
            for name, tick in self.first_saturated_tick.items()
            if tick is not None
        }

    def step(self, tick: int, head_position: float, head_velocity: float) -> tuple[float, float]:
        """Return displacement and velocity output at ``tick`` [V] for a head position [um] and velocity [um/s]."""
        return ldv_step(*self.arrays, tick, head_position, head_velocity)
