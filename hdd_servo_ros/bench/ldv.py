"""The laser Doppler vibrometer and the converter that reads it."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import beyond_codes, converted, converter_codes
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log
from hdd_servo_ros.numerics.noise import normal_pair, uniform_pair
from hdd_servo_ros.parameters import ParameterSet, parameter

LdvArrays = tuple[NDArray[np.float64], NDArray[np.float64]]

OUTPUTS = ('displacement', 'velocity')
NOISE_MEASURES = ('rms', 'density')
DROPOUT_EFFECTS = ('hold', 'zero')
LONGEST_DELAY = 1e-3
"""Upper bound of the demodulator's delay [s]: the motion of so long is kept."""

# Where the constants of ldv_step stand.
DISPLACEMENT_GAIN, VELOCITY_GAIN, RANGE, STEP, LOWEST, HIGHEST = range(6)
NOISE, DISPLACEMENT_NOISE, VELOCITY_NOISE, NOISE_DECAY, NOISE_STEP, SEED = range(6, 12)
TIME_STEP, WHOLE_DELAY, PART_DELAY, KEPT = range(12, 16)
FILTER_DECAY, FILTER_LAST, FILTER_NOW = range(16, 19)
DROPOUT_CHANCE, DROPOUT_SAMPLES, DROPOUT_ZERO = range(19, 22)
CONSTANTS = 22

# Where its state stands; of what comes in pairs, the displacement's is the first. Behind it lie the last KEPT
# positions, then the last KEPT velocities.
DISPLACEMENT_OVERRANGE, VELOCITY_OVERRANGE, DISPLACEMENT_FIRST, VELOCITY_FIRST, DROPPED = range(5)
STARTED, DISPLACEMENT_DEVIATE, VELOCITY_DEVIATE, DROPOUT_LEFT, POSITION_HELD, VELOCITY_HELD = range(5, 11)
POSITION_SEEN, VELOCITY_SEEN, POSITION_FILTERED, VELOCITY_FILTERED = range(11, 15)
HISTORY = 15

DROPOUT_STREAM = 1


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
def _read(constants: NDArray[np.float64], state: NDArray[np.float64], output: int, tick: int, volts: float) -> float:
    """Return an output [V] as the converter reads it: clipped, which is counted, then rounded to its step."""
    if not abs(volts) < math.inf:
        return volts
    limit = constants[RANGE]
    beyond = limit > 0.0 and abs(volts) > limit
    if limit > 0.0:
        volts = min(max(volts, -limit), limit)
    if beyond or beyond_codes(volts, constants[STEP], constants[LOWEST], constants[HIGHEST]):
        if state[DISPLACEMENT_OVERRANGE + output] == 0.0:
            state[DISPLACEMENT_FIRST + output] = float(tick)
        state[DISPLACEMENT_OVERRANGE + output] += 1.0
    return converted(volts, constants[STEP], constants[LOWEST], constants[HIGHEST])


@compiled
def _start(constants: NDArray[np.float64], state: NDArray[np.float64], position: float, velocity: float) -> None:
    """Let the past be the first motion seen, at rest."""
    kept = int(constants[KEPT])
    for i in range(kept):
        state[HISTORY + i] = position
        state[HISTORY + kept + i] = 0.0
    state[POSITION_HELD], state[VELOCITY_HELD] = position, velocity
    state[POSITION_SEEN], state[VELOCITY_SEEN] = position, velocity
    state[POSITION_FILTERED], state[VELOCITY_FILTERED] = position, velocity


@compiled
def _delayed(
    constants: NDArray[np.float64], state: NDArray[np.float64], tick: int, position: float, velocity: float
) -> tuple[float, float]:
    """
    Return position and velocity of the demodulator's delay ago.

    Between two samples the motion is the cubic that has their positions and velocities.
    """
    kept = int(constants[KEPT])
    state[HISTORY + tick % kept] = position
    state[HISTORY + kept + tick % kept] = velocity
    whole, part = int(constants[WHOLE_DELAY]), constants[PART_DELAY]
    if whole == 0 and part == 0.0:
        return position, velocity
    after = (tick - whole + kept) % kept
    x1, v1 = state[HISTORY + after], state[HISTORY + kept + after]
    if part == 0.0:
        return x1, v1
    before = (after - 1 + kept) % kept
    x0, v0 = state[HISTORY + before], state[HISTORY + kept + before]
    time_step = constants[TIME_STEP]
    s = 1.0 - part
    rise = x1 - x0
    x = x0 + s * s * (3.0 - 2.0 * s) * rise + time_step * s * part * (part * v0 - s * v1)
    v = 6.0 * s * part * rise / time_step + (1.0 - 3.0 * s) * part * v0 + s * (3.0 * s - 2.0) * v1
    return x, v


@compiled
def _seen(
    constants: NDArray[np.float64], state: NDArray[np.float64], tick: int, position: float, velocity: float
) -> tuple[float, float]:
    """Return the motion, or what the demodulator takes for it while a speckle is dark."""
    if constants[DROPOUT_CHANCE] > 0.0:
        if state[DROPOUT_LEFT] < 1.0:
            begins, lasts = uniform_pair(np.int64(constants[SEED]), DROPOUT_STREAM, tick)
            if begins < constants[DROPOUT_CHANCE]:
                state[DROPOUT_LEFT] = np.ceil(-log(lasts) * constants[DROPOUT_SAMPLES])
        if state[DROPOUT_LEFT] >= 1.0:
            state[DROPOUT_LEFT] -= 1.0
            state[DROPPED] += 1.0
            if constants[DROPOUT_ZERO] != 0.0:
                return 0.0, 0.0
            return state[POSITION_HELD], state[VELOCITY_HELD]
    state[POSITION_HELD] = position
    state[VELOCITY_HELD] = velocity
    return position, velocity


@compiled
def _filtered(
    constants: NDArray[np.float64], state: NDArray[np.float64], position: float, velocity: float
) -> tuple[float, float]:
    """Return the motion behind the demodulator's low pass, exact for an input that is linear between samples."""
    decay, last, now = constants[FILTER_DECAY], constants[FILTER_LAST], constants[FILTER_NOW]
    if decay > 0.0:
        x = decay * state[POSITION_FILTERED] + last * state[POSITION_SEEN] + now * position
        v = decay * state[VELOCITY_FILTERED] + last * state[VELOCITY_SEEN] + now * velocity
    else:
        x, v = position, velocity
    state[POSITION_SEEN], state[VELOCITY_SEEN] = position, velocity
    state[POSITION_FILTERED], state[VELOCITY_FILTERED] = x, v
    return x, v


@compiled
def ldv_step(
    constants: NDArray[np.float64], state: NDArray[np.float64], tick: int, head_position: float, head_velocity: float
) -> tuple[float, float]:
    """Return displacement and velocity output [V] at ``tick``; see :class:`Ldv`."""
    first = state[STARTED] == 0.0
    if first:
        _start(constants, state, head_position, head_velocity)
        state[STARTED] = 1.0
    position, velocity = _delayed(constants, state, tick, head_position, head_velocity)
    position, velocity = _seen(constants, state, tick, position, velocity)
    position, velocity = _filtered(constants, state, position, velocity)
    displacement_volts = position * constants[DISPLACEMENT_GAIN]
    velocity_volts = velocity * constants[VELOCITY_GAIN]
    if constants[NOISE] != 0.0:
        deviate_0, deviate_1 = normal_pair(np.int64(constants[SEED]), 0, tick)
        if constants[NOISE_DECAY] > 0.0 and not first:
            deviate_0 = constants[NOISE_DECAY] * state[DISPLACEMENT_DEVIATE] + constants[NOISE_STEP] * deviate_0
            deviate_1 = constants[NOISE_DECAY] * state[VELOCITY_DEVIATE] + constants[NOISE_STEP] * deviate_1
        state[DISPLACEMENT_DEVIATE], state[VELOCITY_DEVIATE] = deviate_0, deviate_1
        displacement_volts += constants[DISPLACEMENT_NOISE] * deviate_0
        velocity_volts += constants[VELOCITY_NOISE] * deviate_1
    return _read(constants, state, 0, tick, displacement_volts), _read(constants, state, 1, tick, velocity_volts)


class Ldv:
    """
    The laser Doppler vibrometer of chapter 5 with its analog-to-digital converter.

    The head's motion passes the demodulator (delay, drop-outs, first-order low pass); each output is the result over
    its scale, plus noise, clipped to the output's range, rounded to the converter's step. Each of these can be switched
    off by itself. ``docs/bench.md`` has the models and what each does to the error.

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
        Counts and first ticks of saturation and drop-outs, then what filters, noise and delay remember.
    """

    def __init__(self, parameters: LdvParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._kept = math.ceil(LONGEST_DELAY / sample_time) + 2
        self.state: NDArray[np.float64] = np.zeros(HISTORY + 2 * self._kept)
        self.update(parameters)

    def update(self, parameters: LdvParameters) -> None:
        """Take other parameters from the next tick on; counts and what filters, noise and delay remember go on."""
        self.parameters = parameters
        constants = np.zeros(CONSTANTS)
        constants[DISPLACEMENT_GAIN] = 1.0 / parameters.displacement_scale
        constants[VELOCITY_GAIN] = 1.0 / parameters.velocity_scale
        constants[RANGE] = parameters.output_range
        constants[STEP], constants[LOWEST], constants[HIGHEST] = converter_codes(
            parameters.adc_bits, parameters.adc_range
        )
        self._fill_noise(constants)
        self._fill_demodulator(constants)
        self.constants: NDArray[np.float64] = constants

    def _fill_noise(self, constants: NDArray[np.float64]) -> None:
        parameters, time_step = self.parameters, self.sample_time
        corner = parameters.noise_bandwidth
        displacement, velocity = parameters.displacement_noise, parameters.velocity_noise
        if parameters.noise_measure == 'density':
            # Of the low pass, pi/2 times its corner; of white noise, half the sampling frequency.
            bandwidth = 0.25 * TWO_PI * corner if corner > 0.0 else 0.5 / time_step
            displacement = parameters.displacement_noise_density * math.sqrt(bandwidth)
            velocity = parameters.velocity_noise_density * math.sqrt(bandwidth)
        constants[NOISE] = float(parameters.noise)
        constants[DISPLACEMENT_NOISE] = displacement / parameters.displacement_scale
        constants[VELOCITY_NOISE] = velocity / parameters.velocity_scale
        if corner > 0.0:
            decay = exp(-TWO_PI * corner * time_step)
            constants[NOISE_DECAY] = decay
            constants[NOISE_STEP] = math.sqrt(1.0 - decay * decay)
        constants[SEED] = float(parameters.seed)

    def _fill_demodulator(self, constants: NDArray[np.float64]) -> None:
        parameters, time_step = self.parameters, self.sample_time
        constants[TIME_STEP] = time_step
        constants[KEPT] = self._kept
        samples = parameters.demodulator_delay / time_step
        constants[WHOLE_DELAY] = math.floor(samples)
        constants[PART_DELAY] = samples - math.floor(samples)
        if parameters.demodulator_bandwidth > 0.0:
            angle = TWO_PI * parameters.demodulator_bandwidth * time_step
            decay = exp(-angle)
            constants[FILTER_DECAY] = decay
            constants[FILTER_LAST] = (1.0 - decay) / angle - decay
            constants[FILTER_NOW] = 1.0 - (1.0 - decay) / angle
        if parameters.dropout_rate > 0.0:
            constants[DROPOUT_CHANCE] = 1.0 - exp(-parameters.dropout_rate * time_step)
            constants[DROPOUT_SAMPLES] = parameters.dropout_duration / time_step
            constants[DROPOUT_ZERO] = float(parameters.dropout_effect == 'zero')

    @property
    def arrays(self) -> LdvArrays:
        """The arrays that the kernels take first: constants and state."""
        return self.constants, self.state

    @property
    def saturated_samples(self) -> dict[str, int]:
        """How many samples of each output so far were clipped, by its range or by the converter."""
        return {name: int(self.state[DISPLACEMENT_OVERRANGE + i]) for i, name in enumerate(OUTPUTS)}

    @property
    def first_saturated_tick(self) -> dict[str, int | None]:
        """The first tick at which each output was clipped, None if it never was."""
        return {
            name: int(self.state[DISPLACEMENT_FIRST + i]) if count else None
            for i, (name, count) in enumerate(self.saturated_samples.items())
        }

    @property
    def dropped_samples(self) -> int:
        """How many samples so far fell into a drop-out."""
        return int(self.state[DROPPED])

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
        return ldv_step(self.constants, self.state, tick, head_position, head_velocity)
