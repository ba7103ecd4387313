"""The laser Doppler vibrometer and the converter that reads it."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.parameters import ParameterSet, parameter

# Where the constants of ldv_step stand.
DISPLACEMENT_GAIN, VELOCITY_GAIN, DISPLACEMENT_NOISE, VELOCITY_NOISE, NOISE, SEED, RANGE, STEP, LOWEST, HIGHEST = range(
    10
)
CONSTANTS = 10

# What ldv_step counts in its state.
DISPLACEMENT_OVERRANGE, VELOCITY_OVERRANGE = range(2)
STATES = 2


@dataclasses.dataclass(frozen=True)
class LdvParameters(ParameterSet):
    """Parameters of :class:`Ldv`; defaults as in chapter 5 (8 um/V), where the thesis gives a number."""

    displacement_scale: float = parameter(
        8.0, 'head displacement per volt of the displacement output', unit='um/V', above=0.0
    )
    velocity_scale: float = parameter(5000.0, 'head velocity per volt of the velocity output', unit='um/s/V', above=0.0)
    noise: bool = parameter(True, 'whether the outputs carry noise')
    displacement_noise: float = parameter(
        3e-3, 'rms value of the white noise on the displacement output', unit='um', minimum=0.0
    )
    velocity_noise: float = parameter(
        3.0, 'rms value of the white noise on the velocity output', unit='um/s', minimum=0.0
    )
    seed: int = parameter(
        1, 'seed of the noise; the noise of a tick depends on seed and tick alone', minimum=0, maximum=2**53
    )
    output_range: float = parameter(
        10.0, 'largest magnitude of either output, 0 for none; an output beyond it saturates', unit='V', minimum=0.0
    )
    adc_bits: int = parameter(16, 'resolution of the converter, 0 for an ideal one', unit='bit', minimum=0, maximum=32)
    adc_range: float = parameter(10.0, 'the converter covers -adc_range to +adc_range', unit='V', above=0.0)


@compiled
def _convert(constants: NDArray[np.float64], volts: float) -> float:
    """Return an output [V] as the converter reads it: clipped, then rounded to its step."""
    if not abs(volts) < math.inf:
        return volts
    limit = constants[RANGE]
    if limit > 0.0:
        volts = min(max(volts, -limit), limit)
    step = constants[STEP]
    if step > 0.0:
        # Half a step rounds up: the sides of zero are alike but for exact ties.
        code = np.floor(volts / step + 0.5)
        volts = min(max(code, constants[LOWEST]), constants[HIGHEST]) * step
    return volts


@compiled
def ldv_step(
    constants: NDArray[np.float64], state: NDArray[np.float64], tick: int, head_position: float, head_velocity: float
) -> tuple[float, float]:
    """Return displacement and velocity output [V] at ``tick``; see :class:`Ldv`."""
    displacement = head_position * constants[DISPLACEMENT_GAIN]
    velocity = head_velocity * constants[VELOCITY_GAIN]
    if constants[NOISE] != 0.0:
        first, second = normal_pair(np.int64(constants[SEED]), 0, tick)
        displacement += constants[DISPLACEMENT_NOISE] * first
        velocity += constants[VELOCITY_NOISE] * second
    if constants[RANGE] > 0.0:
        if abs(displacement) > constants[RANGE]:
            state[DISPLACEMENT_OVERRANGE] += 1.0
        if abs(velocity) > constants[RANGE]:
            state[VELOCITY_OVERRANGE] += 1.0
    return _convert(constants, displacement), _convert(constants, velocity)


class Ldv:
    """
    The laser Doppler vibrometer of chapter 5 with its analog-to-digital converter.

    Each output is the head's motion over its scale, plus white noise (one deviate a sample), clipped to the output's
    range, rounded to the converter's step. The noise of tick k is a function of the seed and k alone. Values that are
    not finite pass through, so that a run that has diverged is seen to have.

    Parameters
    ----------
    parameters
        Scales, noise, range and converter.
    sample_time
        T [s]; the noise is one deviate a sample, whatever T is.

    Attributes
    ----------
    state
        Number of ticks so far at which the displacement and the velocity output lay beyond the range.
    """

    def __init__(self, parameters: LdvParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state: NDArray[np.float64] = np.zeros(STATES)
        self.update(parameters)

    def update(self, parameters: LdvParameters) -> None:
        """Take other parameters from the next tick on; the counts of overranges go on."""
        self.parameters = parameters
        constants = np.zeros(CONSTANTS)
        constants[DISPLACEMENT_GAIN] = 1.0 / parameters.displacement_scale
        constants[VELOCITY_GAIN] = 1.0 / parameters.velocity_scale
        constants[DISPLACEMENT_NOISE] = parameters.displacement_noise / parameters.displacement_scale
        constants[VELOCITY_NOISE] = parameters.velocity_noise / parameters.velocity_scale
        constants[NOISE] = float(parameters.noise)
        constants[SEED] = float(parameters.seed)
        constants[RANGE] = parameters.output_range
        if parameters.adc_bits > 0:
            codes = 2 ** (parameters.adc_bits - 1)
            constants[STEP] = parameters.adc_range / codes
            constants[LOWEST] = -codes
            constants[HIGHEST] = codes - 1
        self.constants: NDArray[np.float64] = constants

    def step(self, tick: int, head_position: float, head_velocity: float) -> tuple[float, float]:
        """Return displacement and velocity output [V] for a head position [um] and velocity [um/s] at ``tick``."""
        return ldv_step(self.constants, self.state, tick, head_position, head_velocity)
