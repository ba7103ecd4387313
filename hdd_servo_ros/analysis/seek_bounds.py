"""
Lower bounds of the seek time: time-optimal seek of the rigid body, and fastest seek of the sampled drive with modes.

Both are from rest to rest with Coulomb and viscous friction, and with abs(u) <= u_max.
"""

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_drive import NOT_VISCOUS_MODELS, sampled_drive
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import ResonanceParameters

Array = NDArray[np.float64]

NO_LEVEL_MODELS = ('none', 'stiction', 'tangential_stiffness', 'viscous', 'drag', 'rbf_network')
"""Friction models without Coulomb friction in fast sliding; the others have ``coulomb_level``."""
TOLERANCE = 0.1
"""Tolerance of the arrival for the fastest seek of the sampled drive [um]."""
SPREAD = 0.05
"""Relative change of the mode frequencies in both directions for which the same command must arrive."""
PARTS = 5
"""Instants per sample, so that the head may arrive between samples."""
WATCHED = 1.5e-3
"""Time after arrival in which the head must stay within the tolerance [s]; a mode decays to a fifth."""


@dataclasses.dataclass(frozen=True)
class TimeOptimalSeek:
    """
    The time-optimal seek of the rigid body: full voltage forward, then full voltage backward.

    Attributes
    ----------
    time
        Time T* [s].
    peak_velocity
        Velocity when u changes sign [um/s].
    acceleration_time
        Time when u changes sign [s].
    """

    time: float
    peak_velocity: float
    acceleration_time: float


@dataclasses.dataclass(frozen=True)
class FastestSeek:
    """
    The fastest seek of the sampled drive.

    Attributes
    ----------
    time
        Arrival time [s], a multiple of T / ``PARTS``.
    error
        Largest position error after it [um], for the worst of the drives.
    control
        Command per sample [V], shape (n,): u held over [kT, (k+1)T).
    """

    time: float
    error: float
    control: Array


def sliding_level(plant: PlantParameters) -> float:
    """Return the Coulomb friction in fast sliding [V]; 0 for a model without it."""
    return 0.0 if plant.friction.model in NO_LEVEL_MODELS else plant.friction.coulomb_level


def time_optimal_seek(plant: PlantParameters, distance: float) -> TimeOptimalSeek:
    """
    Return the time-optimal seek of the rigid body with friction, from rest to rest.

    With a = gain, v' = a (u_max - f_c) - a f_v v forward and v' = -a (u_max + f_c) - a f_v v backward. Time and length
    of both parts are closed forms of the time when u changes sign, which follows from the length by bisection.

    Parameters
    ----------
    plant
        The drive; of its friction the Coulomb part f_c and the viscous part f_v are used, its modes are ignored.
    distance
        Length of the seek [um]; its sign does not matter.

    Raises
    ------
    ValueError
        If the length is not finite, the friction is not below ``control_limit`` or the drive has no rigid body.
    """
    if not plant.resonance.has_rigid_body:
        raise ValueError('a drive with resonance form modes has no rigid body, so its seeks have no time-optimal bound')
    length = abs(distance)
    if not length < math.inf:
        raise ValueError(f'invalid length of a seek: {distance:g} um; expected a finite number')
    level, limit, gain = sliding_level(plant), plant.control_limit, plant.rigid_gain
    if level >= limit:
        raise ValueError(f'no seek is possible: control_limit = {limit:g} V is not above the friction of {level:g} V')
    if length == 0.0:
        return TimeOptimalSeek(0.0, 0.0, 0.0)
    friction = plant.friction
    damping = gain * (0.0 if friction.model in NOT_VISCOUS_MODELS else friction.viscous_coefficient)
    ahead, back = gain * (limit - level), gain * (limit + level)

    def speed_and_length(seconds: float) -> tuple[float, float]:
        """Return peak velocity [um/s] and length [um] of a seek for a time of acceleration [s]."""
        z = damping * seconds
        peak = ahead * seconds * _speed_factor(z)
        return peak, ahead * seconds**2 * _way_factor(z) + peak**2 / back * _braking_way_factor(damping * peak / back)

    low, high = 0.0, math.sqrt(length / (gain * limit))
    while speed_and_length(high)[1] < length:
        low, high = high, 2.0 * high
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if speed_and_length(middle)[1] < length else (low, middle)
    peak = speed_and_length(high)[0]
    return TimeOptimalSeek(high + peak / back * _braking_time_factor(damping * peak / back), peak, high)


# Factors of damping for v = At, s = At^2 in acceleration, and t = v/A, s = v^2/A in braking.

_SMALL = 0.01
"""Below this value a series avoids cancellation."""


def _speed_factor(z: float) -> float:
    """Return (1 - exp(-z))/z."""
    return -math.expm1(-z) / z if z > 0.0 else 1.0


def _way_factor(z: float) -> float:
    """Return (exp(-z) - 1 + z)/z^2."""
    if z < _SMALL:
        return sum((-z) ** k / math.factorial(k + 2) for k in range(8))
    return (math.expm1(-z) + z) / (z * z)


def _braking_time_factor(z: float) -> float:
    """Return ln(1 + z)/z."""
    return math.log1p(z) / z if z > 0.0 else 1.0


def _braking_way_factor(z: float) -> float:
    """Return (z - ln(1 + z))/z^2."""
    if z < _SMALL:
        return sum((-z) ** k / (k + 2.0) for k in range(9))
    return (z - math.log1p(z)) / (z * z)


def scaled_modes(resonance: ResonanceParameters, factor: float) -> ResonanceParameters:
    """Return resonances with scaled frequencies and unchanged damping ratios and residues."""
    if resonance.form == 'sections':
        powers = np.array([1.0, factor, factor * factor])
        above, below = (
            tuple((np.reshape(numbers, (-1, 3)) * powers).ravel().tolist())
            for numbers in (resonance.numerators, resonance.denominators)
        )
        return dataclasses.replace(resonance, numerators=above, denominators=below)
    return dataclasses.replace(resonance, frequencies=tuple(factor * f for f in resonance.frequencies))


def fastest_seek(
    plant: PlantParameters,
    sample_time: float,
    distance: float,
    tolerance: float = TOLERANCE,
    spread: float = SPREAD,
) -> FastestSeek:
    """
    Return the fastest seek of the sampled drive with its modes, by linear programming.

    The same command must work for three drives, with nominal mode frequencies and with ``spread`` lower and higher; it
    is limited only by abs(u) <= ``control_limit``, before and after the arrival. The head has arrived at the first
    instant from which it stays within the tolerance for :data:`WATCHED`, for all three drives. Instants are T /
    :data:`PARTS` apart, so that motion between samples counts. The drive is linear, as in sliding, with viscous
    friction and Coulomb friction as a constant force against the motion.

    The bound holds for a precomputed command: feedback of the modes could do better if their frequencies differ. The
    stiffness of the contact at the end is neglected.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    distance
        Length of the seek [um]; its sign does not matter.
    tolerance
        Largest position error after arrival [um].
    spread
        Relative change of the mode frequencies.

    Raises
    ------
    ValueError
        If the tolerance is not positive, or for the reasons of :func:`time_optimal_seek`.
    """
    if not tolerance > 0.0:
        raise ValueError(f'invalid tolerance of a seek: {tolerance:g} um; expected above 0')
    length, instant = abs(distance), sample_time / PARTS
    if length <= tolerance:
        return FastestSeek(0.0, length, np.zeros(0))
    watched = math.ceil(WATCHED / sample_time - 1e-9)
    problem = _Problem(plant, sample_time, spread, length, watched)
    # At instant 0 the head has not moved.
    low = 0
    high = math.ceil(time_optimal_seek(plant, length).time / instant) + PARTS
    while (best := problem.smallest_error(high))[0] > tolerance:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        found = problem.smallest_error(middle)
        if found[0] > tolerance:
            low = middle
        else:
            high, best = middle, found
    return FastestSeek(high * instant, *best)


class _Problem:
    """Minimization of the largest error from an instant on, over all commands."""

    def __init__(self, plant: PlantParameters, sample_time: float, spread: float, length: float, watched: int) -> None:
        self._plant, self._sample_time, self._spread = plant, sample_time, spread
        self._length, self._watched = length, watched
        level, limit = sliding_level(plant), plant.control_limit
        # The force on the body: u minus the friction.
        self._level, self._range = level, (-limit - level, limit - level)

    def smallest_error(self, arrival: int) -> tuple[float, Array]:
        """Return the smallest possible peak error [um] from an instant on, and its command [V]."""
        from scipy.optimize import linprog

        samples = -(-arrival // PARTS) + self._watched
        instants = arrival + np.arange(self._watched * PARTS + 1)
        since = np.maximum(instants[:, None] - PARTS * np.arange(samples), 0)
        rows = []
        for factor in sorted({1.0 - self._spread, 1.0, 1.0 + self._spread}):
            # Position at each instant after a pulse of one sample.
            pulse = _pulse_response(self._plant, self._sample_time, factor, PARTS * (samples + 1))
            rows.append(pulse[since])
        positions = np.vstack(rows)
        slack = np.ones((len(positions), 1))
        target = np.full(len(positions), self._length)
        found = linprog(
            np.append(np.zeros(samples), 1.0),
            A_ub=np.block([[positions, -slack], [-positions, -slack]]),
            b_ub=np.concatenate([target, -target]),
            bounds=[self._range] * samples + [(0.0, None)],
            method='highs',
        )
        if found.status != 0:
            raise RuntimeError(f'the linear program of a seek of {self._length:g} um failed: {found.message}')
        return float(found.fun), np.asarray(found.x[:-1] + self._level)


@functools.lru_cache(maxsize=16)
def _impulse_response(plant: PlantParameters, instant: float, factor: float, count: int) -> Array:
    """Return the position [um] at each instant after 1 V during the first of them."""
    modes = dataclasses.replace(plant, resonance=scaled_modes(plant.resonance, factor), input_delay=0.0)
    drive = sampled_drive(modes, instant, presliding=False)
    state, positions = drive.b[:, 0], [0.0]
    for _ in range(count - 1):
        positions.append(float(drive.c[0] @ state))
        state = drive.a @ state
    return np.array(positions)


def _pulse_response(plant: PlantParameters, sample_time: float, factor: float, count: int) -> Array:
    """Return the position [um] at each instant after 1 V during the first sample, shape (count,)."""
    # Lengths in powers of two, so that searches share the result.
    shared = 1 << (count - 1).bit_length()
    impulse = _impulse_response(plant, sample_time / PARTS, factor, shared)[:count]
    return np.asarray(sum(np.concatenate([np.zeros(part), impulse[: count - part]]) for part in range(PARTS)))
