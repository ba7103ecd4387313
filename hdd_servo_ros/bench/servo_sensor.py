"""Servo sensor: position decoded from the bursts and track numbers of the servo sectors of a drive."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import converted
from hdd_servo_ros.bench.instrument_output import OVERRANGE
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import sine_cosine_of_turns
from hdd_servo_ros.numerics.noise import normal_pair, uniform_pair
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

Array = NDArray[np.float64]
ServoSensorArrays = tuple[Array, Array, Array]
"""Constants, mask of the missing sectors, state."""

SERVO_SENSOR = layout(
    'pitch', 'sectors', 'noise', 'seed', 'nonlinearity', 'step', 'lowest', 'highest', 'missing_probability'
)
SERVO_SENSOR_STATE = layout(('fraction', OVERRANGE), 'error', 'position', 'missing_sectors')

NOISE_STREAM, MISSING_STREAM = 40, 41
"""Streams of the counter-based noise; distinct from those of the other instruments and of the disturbances."""


@dataclasses.dataclass(frozen=True)
class MissingSectorParameters(ParameterSet):
    """Sectors that cannot be read; the sensor holds the last decoded values."""

    sectors: tuple[int, ...] = parameter(
        (), 'numbers of the sectors that are missing in every revolution', minimum=0, element=int
    )
    probability: float = parameter(
        0.0, 'probability that any other sector is missing (random, set by seed)', minimum=0.0, maximum=1.0
    )


@dataclasses.dataclass(frozen=True)
class ServoSensorParameters(ParameterSet):
    """Parameters of :class:`ServoSensor`; each sample is one servo sector."""

    track_pitch: float = parameter(1.016, 'track pitch p; 1.016 um is 25 000 tracks per inch', unit='um', above=0.0)
    sectors: int = parameter(
        0,
        'servo sectors per revolution, for the sector number; 0 numbers the sectors continuously',
        minimum=0,
        maximum=1_000_000,
        read_only=True,
    )
    noise: float = parameter(0.003, 'rms white noise of the track fraction per sector', unit='um', minimum=0.0)
    seed: int = parameter(1, 'seed of noise and missing sectors', minimum=0, maximum=2**53)
    bits: int = parameter(
        12,
        'resolution of the track fraction, 2^bits codes per pitch; 0 for no quantization',
        unit='bit',
        minimum=0,
        maximum=32,
    )
    nonlinearity: float = parameter(
        0.0,
        'amplitude of the sinusoidal error of the track fraction; the error is 0 at and halfway between track centers',
        unit='% of pitch',
        minimum=-15.0,
        maximum=15.0,
    )
    missing: MissingSectorParameters = group(MissingSectorParameters)

    def check_together(self) -> None:
        """Check that the numbers of the missing sectors are valid, and that at least one sector remains."""
        missing = self.missing.sectors
        if missing and not self.sectors:
            raise ParameterError(
                'missing.sectors', missing, 'an empty list, because sectors = 0 does not define a revolution'
            )
        if missing and max(missing) >= self.sectors:
            raise ParameterError('missing.sectors', missing, f'numbers below sectors, which is {self.sectors}')
        if missing and len(set(missing)) == self.sectors:
            raise ParameterError('missing.sectors', missing, f'fewer than all {self.sectors} sectors')


@compiled
def _is_missing(c: np.record, missing: Array, sector: int, tick: int) -> bool:
    """Return whether the sector of a tick cannot be read."""
    if sector < len(missing) and missing[sector] != 0.0:
        return True
    probability: float = c.missing_probability
    return probability > 0.0 and uniform_pair(np.int64(c.seed), MISSING_STREAM, tick)[0] < probability


@compiled_apart
def servo_sensor_step(
    constants: Array, missing: Array, state: Array, tick: int, head: float, track_center: float
) -> tuple[float, float, float]:
    """Return position error [um], position [um] and sector number at ``tick``; see :meth:`ServoSensor.step`."""
    c = record(constants, SERVO_SENSOR)
    s = record(state, SERVO_SENSOR_STATE)
    sectors = int(c.sectors)
    sector = tick % sectors if sectors > 0 else tick
    # No value can be held at tick 0: assume that the drive has read the sector from which it found its track.
    if tick > 0 and _is_missing(c, missing, sector, tick):
        s.missing_sectors += 1.0
        return s.error, s.position, float(sector)
    pitch = c.pitch
    distance = head - track_center
    if not abs(distance) < math.inf:
        return distance, distance, float(sector)
    track = np.floor(distance / pitch + 0.5)
    fraction = distance - track * pitch
    if c.nonlinearity != 0.0:
        fraction += c.nonlinearity * sine_cosine_of_turns(fraction / pitch)[0]
    if c.noise > 0.0:
        fraction += c.noise * normal_pair(np.int64(c.seed), NOISE_STREAM, tick)[0]
    if abs(fraction) > 0.5 * pitch:
        if s.fraction.samples == 0.0:
            s.fraction.first_tick = float(tick)
        s.fraction.samples += 1.0
    if c.step > 0.0:
        fraction = converted(fraction, c.step, c.lowest, c.highest)
    else:
        fraction = min(max(fraction, -0.5 * pitch), 0.5 * pitch)
    s.error = fraction
    s.position = track * pitch + fraction
    return s.error, s.position, float(sector)


class ServoSensor:
    """
    Position sensor of a drive: servo sectors with track number and bursts, one sector per sample.

    The distance of the head from the center of track 0, which runout and flutter displace, is split into the number of
    the nearest track and a fraction within half a track on either side. These effects are applied to the fraction in
    this order: nonlinearity a p sin(2 pi x/p) of the burst pattern with pitch p, white noise, limits of half a track,
    quantization. The position is track number times pitch plus fraction. With the reference on a track center,
    x_d = n p, the position error signal (PES) is position - x_d. The track number is always decoded correctly.

    At a missing sector the last values are held. The random numbers of a tick are a function of the seed and the tick
    only. The sensor has no velocity output.

    Parameters
    ----------
    parameters
        Parameters of tracks, sectors and errors.
    sample_time
        T [s]; unused, because each sample is one sector, but present for consistency with the other blocks.

    Notes
    -----
    Source: a model of this package; ``docs/instruments/servo-sensor.md`` describes it.

    Examples
    --------
    A head 5.2 µm from the center of track 0, with 25 000 tracks per inch:

    >>> from hdd_servo_ros.bench import ServoSensor, ServoSensorParameters
    >>> sensor = ServoSensor(ServoSensorParameters(noise=0.0), sample_time=1e-4)
    >>> error, position, sector = sensor.step(0, 5.2)  # um, um
    >>> round(error, 4), round(position, 4), sector
    (0.1201, 5.2001, 0.0)
    """

    def __init__(self, parameters: ServoSensorParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self.state = zeros(SERVO_SENSOR_STATE)
        self.update(parameters)

    def update(self, parameters: ServoSensorParameters) -> None:
        """Change the parameters from the next tick on; the counts and the held values are kept."""
        self.parameters = parameters
        constants = zeros(SERVO_SENSOR)
        c = record(constants, SERVO_SENSOR)
        c.pitch = parameters.track_pitch
        c.sectors = float(parameters.sectors)
        c.noise = parameters.noise
        c.seed = float(parameters.seed)
        c.nonlinearity = 0.01 * parameters.nonlinearity * parameters.track_pitch
        if parameters.bits:
            # The codes are symmetric about the track center, which is a code itself.
            c.step = parameters.track_pitch / 2.0**parameters.bits
            c.highest = 2.0 ** (parameters.bits - 1)
            c.lowest = -c.highest
        c.missing_probability = parameters.missing.probability
        missing = np.zeros(max(parameters.missing.sectors, default=-1) + 1)
        missing[list(parameters.missing.sectors)] = 1.0
        self.arrays: ServoSensorArrays = (constants, missing, self.state)

    @property
    def saturated_samples(self) -> dict[str, int]:
        """Number of track fractions clipped to half a track so far."""
        return {'fraction': int(record(self.state, SERVO_SENSOR_STATE).fraction.samples)}

    @property
    def missing_sectors(self) -> int:
        """Number of sectors that could not be read so far."""
        return int(record(self.state, SERVO_SENSOR_STATE).missing_sectors)

    def saturation_warnings(self) -> dict[str, str]:
        """Return a warning if a track fraction was clipped."""
        found = record(self.state, SERVO_SENSOR_STATE).fraction
        if not found.samples:
            return {}
        text = (
            f'the track fraction exceeds half the pitch, {0.5 * self.parameters.track_pitch:g} um, at tick '
            f'{int(found.first_tick)}; further samples are counted, not logged'
        )
        return {'fraction': text}

    def step(self, tick: int, head: float, track_center: float = 0.0) -> tuple[float, float, float]:
        """
        Return the decoded position at the servo sector of a tick.

        Parameters
        ----------
        tick
            Tick k.
        head
            Head position [um].
        track_center
            Displacement of the track centers at this tick [um].

        Returns
        -------
        error, position, sector
            Distance from the nearest track center [um], position including the track number [um], sector number.
        """
        return servo_sensor_step(*self.arrays, tick, head, track_center)
