"""The laser Doppler vibrometer and the converter that reads it."""

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
"""Upper bound of the demodulator's delay [s]: the motion of so long is kept."""

LdvArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Constants, state, and the motion of the last ticks."""

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
    'whole_delay',
    'part_delay',
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
    'dropout_left',
    'position_held',
    'velocity_held',
    'position_seen',
    'velocity_seen',
    'position_filtered',
    'velocity_filtered',
)

NOISE_STREAM, DROPOUT_STREAM = range(2)
"""Which numbers of a tick are for the noise, and which for drop-outs."""


@dataclasses.dataclass(frozen=True)
class LdvParameters(ParameterSet):
    """Parameters of :class:`Ldv`; defaults as in chapter 5 (8 um/V), where the thesis gives a number."""

    displacement_scale: float = parameter(
        8.0, 'head displacement per volt of the displacement output', unit='um/V', above=0.0, read_only=True
    )
    velocity_scale: float = parameter(
        5000.0, 'head velocity per volt of the velocity output', unit='um/s/V', above=0.0, read_only=True
    )
    noise: bool = parameter(True, 'whether the outputs carry noise')
    noise_measure: str = parameter(
        'rms',
        'what the noise is given by: the rms values displacement_noise and velocity_noise, or the densities',
        choices=NOISE_MEASURES,
    )
    displacement_noise: float = parameter(
        3e-3, 'rms value of the noise on the displacement output', unit='um', minimum=0.0
    )
    velocity_noise: float = parameter(3.0, 'rms value of the noise on the velocity output', unit='um/s', minimum=0.0)
    displacement_noise_density: float = parameter(
        4.24e-5,
        'one-sided amplitude density, at low frequency, of the noise on the displacement output',
        unit='um/sqrt(Hz)',
        minimum=0.0,
    )
    velocity_noise_density: float = parameter(
        4.24e-2,
        'one-sided amplitude density, at low frequency, of the noise on the velocity output',
        unit='um/s/sqrt(Hz)',
        minimum=0.0,
    )
    noise_bandwidth: float = parameter(
        0.0,
        'corner frequency of the first-order low pass that has formed the noise; 0 for noise that is white up to half '
        'the sampling frequency',
        unit='Hz',
        minimum=0.0,
    )
    seed: int = parameter(
        1,
        'seed of noise and drop-outs; what is drawn for a tick depends on seed and tick alone',
        minimum=0,
        maximum=2**53,
    )
    demodulator_delay: float = parameter(
        0.0, 'delay of the demodulator, any part of a sample; 0 for none', unit='s', minimum=0.0, maximum=LONGEST_DELAY
    )
    demodulator_bandwidth: float = parameter(
        0.0, 'corner frequency of the first-order low pass of the demodulator, 0 for none', unit='Hz', minimum=0.0
    )
    dropout_rate: float = parameter(
        0.0, 'mean number of drop-outs (dark speckles) in a second of light, 0 for none', unit='1/s', minimum=0.0
    )
    dropout_duration: float = parameter(2e-4, 'mean duration of a drop-out', unit='s', above=0.0)
    dropout_effect: str = parameter(
        'hold',
        'what the demodulator takes for the motion during a drop-out: the last it has seen, or none (0 um, 0 um/s)',
        choices=DROPOUT_EFFECTS,
    )
    output_range: float = parameter(
        10.0, 'largest magnitude of either output, 0 for none; an output beyond it saturates', unit='V', minimum=0.0
    )
    adc_bits: int = parameter(16, 'resolution of the converter, 0 for an ideal one', unit='bit', minimum=0, maximum=32)
    adc_range: float = parameter(10.0, 'the converter covers -adc_range to +adc_range', unit='V', above=0.0)

    def levels(self) -> tuple[float, float]:
        """Return the lowest and the highest voltage that an output can show [V]; infinities if nothing limits it."""
        step, lowest, highest = converter_codes(self.adc_bits, self.adc_range)
        reach = self.output_range if self.output_range > 0.0 else math.inf
        if step == 0.0:
            return -reach, reach
        # Rounding may take the range's end to the next code.
        ends = [converted(volts, step, lowest, highest) for volts in (-reach, reach)]
        return ends[0], ends[1]


@compiled
def _start(s: np.record, history: NDArray[np.float64], position: float, velocity: float) -> None:
    """Let the past be the first motion seen, at rest."""
    for i in range(len(history)):
        history[i, 0], history[i, 1] = position, 0.0
    s.position_held, s.velocity_held = position, velocity
    s.position_seen, s.velocity_seen = position, velocity
    s.position_filtered, s.velocity_filtered = position, velocity


@compiled
def _delayed(
    c: np.record, history: NDArray[np.float64], tick: int, position: float, velocity: float
) -> tuple[float, float]:
    """
    Return position and velocity of the demodulator's delay ago.

    Between two samples the motion is the cubic that has their positions and velocities.
    """
    kept = len(history)
    history[tick % kept, 0], history[tick % kept, 1] = position, velocity
    whole, part = int(c.whole_delay), c.part_delay
    if whole == 0 and part == 0.0:
        return position, velocity
    after = (tick - whole + kept) % kept
    x1, v1 = history[after, 0], history[after, 1]
    if part == 0.0:
        return x1, v1
    before = (after - 1 + kept) % kept
    x0, v0 = history[before, 0], history[before, 1]
    time_step = c.time_step
    s = 1.0 - part
    rise = x1 - x0
    x = x0 + s * s * (3.0 - 2.0 * s) * rise + time_step * s * part * (part * v0 - s * v1)
    v = 6.0 * s * part * rise / time_step + (1.0 - 3.0 * s) * part * v0 + s * (3.0 * s - 2.0) * v1
    return x, v


@compiled
def _seen(c: np.record, s: np.record, tick: int, position: float, velocity: float) -> tuple[float, float]:
    """Return the motion, or what the demodulator takes for it while a speckle is dark."""
    if c.dropout_chance > 0.0:
        if s.dropout_left < 1.0:
            begins, lasts = uniform_pair(np.int64(c.seed), DROPOUT_STREAM, tick)
            if begins < c.dropout_chance:
                s.dropout_left = np.ceil(-log(lasts) * c.dropout_samples)
        if s.dropout_left >= 1.0:
            s.dropout_left -= 1.0
            s.dropped_samples += 1.0
            if c.is_dropout_zero != 0.0:
                return 0.0, 0.0
            return s.position_held, s.velocity_held
    s.position_held = position
    s.velocity_held = velocity
    return position, velocity


@compiled
def _filtered(c: np.record, s: np.record, position: float, velocity: float) -> tuple[float, float]:
    """Return the motion behind the demodulator's low pass, exact for an input that is linear between samples."""
    decay, last, now = c.filter_decay, c.filter_last, c.filter_now
    if decay > 0.0:
        x = decay * s.position_filtered + last * s.position_seen + now * position
        v = decay * s.velocity_filtered + last * s.velocity_seen + now * velocity
    else:
        x, v = position, velocity
    s.position_seen, s.velocity_seen = position, velocity
    s.position_filtered, s.velocity_filtered = x, v
    return x, v


@compiled
def fill_ldv_deviates(constants: NDArray[np.float64], first_tick: int, deviates: NDArray[np.float64]) -> None:
    """
    Write the standard normal deviates of the noise of consecutive ticks, for :func:`ldv_output`.

    Parameters
    ----------
    constants
        Laid out as ``LDV``.
    first_tick
        The first tick.
    deviates
        Takes the deviate of the displacement and of the velocity output of each tick, one after the other, shape
        (2 n,); left as it is if the outputs carry no noise.
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
    """Return displacement and velocity output [V] at ``tick``; see :class:`Ldv`."""
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
    """Return what :func:`ldv_step` does, for given deviates of the noise of ``tick``; see :func:`fill_ldv_deviates`."""
    c = record(constants, LDV)
    s = record(state, LDV_STATE)
    first = s.has_started == 0.0
    if first:
        _start(s, history, head_position, head_velocity)
        s.has_started = 1.0
    position, velocity = _delayed(c, history, tick, head_position, head_velocity)
    position, velocity = _seen(c, s, tick, position, velocity)
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
    The laser Doppler vibrometer of chapter 5 with its analog-to-digital converter.

    The head's motion passes the demodulator (delay, drop-outs, first-order low pass); each output is the result over
    its scale, plus noise, clipped to the output's range, rounded to the converter's step. Each of these can be switched
    off by itself. ``docs/instruments/ldv.md`` has the models and what each does to the error.

    With ``noise_bandwidth`` = 0 the noise is one deviate a sample: white up to half the sampling frequency, of the
    given rms value or, given as density D, of D sqrt(1/(2T)). With a bandwidth f it is white noise behind a first-order
    low pass, sampled: an autoregression with the pole exp(-2 pi f T), which has the autocovariance of the sampled
    process, what folds down included. Its rms value is the given one, or D sqrt(pi f/2).

    What is drawn for a tick is a function of the seed and the tick alone. Values that are not finite pass through, so
    that a run that has diverged is seen to have.

    Parameters
    ----------
    parameters
        Scales, demodulator, noise, range and converter.
    sample_time
        T [s].

    Attributes
    ----------
    state
        Counts and first ticks of saturation and drop-outs, then what filters and noise remember.
    history
        Position and velocity of the last ticks, of the longest delay's length; tick k is in row k modulo the length.

    Notes
    -----
    Source: thesis section 5.2 for the 8 um/V; the demodulator and the noise are models of this package.

    Examples
    --------
    >>> from hdd_servo_ros.bench import Ldv, LdvParameters
    >>> ldv = Ldv(LdvParameters(), sample_time=1e-4)
    >>> displacement, velocity = ldv.step(0, 2.0, 100.0)  # V, of a head at 2 um and 100 um/s
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
        """Take other parameters from the next tick on; counts and what filters, noise and delay remember go on."""
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
            # Of the low pass, pi/2 times its corner; of white noise, half the sampling frequency.
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
        c.whole_delay = math.floor(samples)
        c.part_delay = samples - math.floor(samples)
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
        """How many samples of each output so far were clipped, by its range or by the converter."""
        state = record(self.state, LDV_STATE)
        return {name: int(state[name].samples) for name in OUTPUTS}

    @property
    def first_saturated_tick(self) -> dict[str, int | None]:
        """The first tick at which each output was clipped, None if it never was."""
        state = record(self.state, LDV_STATE)
        return {name: int(state[name].first_tick) if state[name].samples else None for name in OUTPUTS}

    @property
    def dropped_samples(self) -> int:
        """How many samples so far fell into a drop-out."""
        return int(record(self.state, LDV_STATE).dropped_samples)

    def saturation_warnings(self) -> dict[str, str]:
        """Return, for each output that has been clipped, what a user should be told."""
        scales = {
            'displacement': (self.parameters.displacement_scale, 'um'),
            'velocity': (self.parameters.velocity_scale, 'um/s'),
        }
        highest = self.parameters.levels()[1]
        return {
            name: f'the {name} output saturates at tick {tick}: it ends at {highest:g} V, '
            f'{highest * scales[name][0]:g} {scales[name][1]}; further samples are counted, not told'
            for name, tick in self.first_saturated_tick.items()
            if tick is not None
        }

    def step(self, tick: int, head_position: float, head_velocity: float) -> tuple[float, float]:
        """Return displacement and velocity output [V] for a head position [um] and velocity [um/s] at ``tick``."""
        return ldv_step(*self.arrays, tick, head_position, head_velocity)
