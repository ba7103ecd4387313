"""
Rest-to-rest trajectories of a seek: duration within the limits, and position and derivatives as functions of time.

The minimum-jerk trajectory is the polynomial of degree 5 with zero velocity and acceleration at both ends (Flash,
Hogan, Journal of Neuroscience 5, 1985). The time-optimal trajectory has at most seven segments. In each segment jerk,
acceleration or velocity is at its limit, and the trajectory is symmetric about its middle.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp, log
from hdd_servo_ros.numerics.records import layout


class Trajectory(IntEnum):
    """Trajectories, numbered for compiled code."""

    STEP = 0
    MINIMUM_JERK = 1
    TIME_OPTIMAL = 2


TRAJECTORIES = tuple(trajectory.name.lower() for trajectory in Trajectory)

SEEK = layout(
    'start',
    'samples',
    'origin',
    'target',
    'trajectory',
    'duration',
    'jerk_time',
    'acceleration_time',
    'acceleration',
)
"""
Layout of a seek.

``start`` [ticks from the start of the list], ``samples`` and ``duration`` [s] of the trajectory, ``origin`` and
``target`` [um]. The last three fields are for the time-optimal trajectory: rise time of the acceleration [s], time at
peak acceleration [s], and peak acceleration with the sign of the seek [um/s^2].
"""

_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Peak acceleration of the minimum-jerk trajectory of length 1 and duration 1; peak jerk and velocity are below."""
_PEAK_JERK = 60.0
_PEAK_VELOCITY = 1.875

_SEGMENT_TOLERANCE = 1e-9
"""
Tolerance of a time with respect to the end of a segment, as a fraction of the duration.

Without a jerk limit the acceleration is discontinuous, and rounding must not decide at which sample it changes.
"""


class Bounds(NamedTuple):
    """Limits of a trajectory: acceleration [um/s^2], jerk [um/s^3] and velocity [um/s]; 0 for no limit."""

    acceleration: float
    jerk: float = 0.0
    velocity: float = 0.0


class Segments(NamedTuple):
    """
    Segments of a time-optimal trajectory.

    The acceleration rises for ``jerk_time``, is constant for ``acceleration_time`` and falls for ``jerk_time``. The
    velocity is then constant for ``cruise_time``, and the first three segments follow with the opposite sign. All times
    are in s.
    """

    jerk_time: float
    acceleration_time: float
    cruise_time: float

    @property
    def duration(self) -> float:
        """Duration of the trajectory [s]."""
        return 2.0 * (2.0 * self.jerk_time + self.acceleration_time) + self.cruise_time


def cube_root(x: float) -> float:
    """Return the cube root of x >= 0, bit-identical on every machine."""
    if x <= 0.0:
        return 0.0
    root: float = exp(log(x) / 3.0)
    # One Newton step removes the rounding error of the logarithm.
    return root - (root - x / (root * root)) / 3.0


def time_optimal_segments(length: float, bounds: Bounds) -> Segments:
    """Return the segments of the fastest trajectory over a length >= 0 [um] within all limits."""
    acceleration, jerk, velocity = bounds
    if length <= 0.0:
        return Segments(0.0, 0.0, 0.0)
    rise = acceleration / jerk if jerk > 0.0 else 0.0
    if length < 2.0 * acceleration * rise * rise:
        # Too short to reach the acceleration limit: L = 2 j t^3.
        rise = cube_root(0.5 * length / jerk)
        stay = 0.0
    else:
        # a (t_j + t_a)(2 t_j + t_a) = L.
        stay = max(math.sqrt(0.25 * rise * rise + length / acceleration) - 1.5 * rise, 0.0)
    reached = acceleration if stay > 0.0 or jerk == 0.0 else jerk * rise
    if velocity == 0.0 or reached * (rise + stay) <= velocity:
        return Segments(rise, stay, 0.0)
    full_rise = acceleration / jerk if jerk > 0.0 else 0.0
    if velocity < acceleration * full_rise:
        rise, stay = math.sqrt(velocity / jerk), 0.0
    else:
        rise, stay = full_rise, velocity / acceleration - full_rise
    return Segments(rise, stay, max(length / velocity - 2.0 * rise - stay, 0.0))


def trajectory_time(trajectory: str, length: float, bounds: Bounds) -> float:
    """Return the shortest duration [s] of a trajectory over a length >= 0 [um] within all limits."""
    if trajectory == 'step' or length <= 0.0:
        return 0.0
    if trajectory == 'time_optimal':
        return time_optimal_segments(length, bounds).duration
    duration = math.sqrt(_PEAK_ACCELERATION * length / bounds.acceleration)
    if bounds.jerk > 0.0:
        duration = max(duration, cube_root(_PEAK_JERK * length / bounds.jerk))
    if bounds.velocity > 0.0:
        duration = max(duration, _PEAK_VELOCITY * length / bounds.velocity)
    return duration


def set_trajectory(seek: Any, trajectory: str, bounds: Bounds, samples: int, sample_time: float) -> None:
    """
    Set the trajectory of a record with the layout :data:`SEEK` that has origin and target.

    Parameters
    ----------
    seek
        Record of the seek.
    trajectory
        One of :data:`TRAJECTORIES`.
    bounds
        Limits of the trajectory.
    samples
        Duration [samples], at least :func:`trajectory_time`; the trajectory is stretched to it.
    sample_time
        T [s].
    """
    distance = float(seek.target - seek.origin)
    seek.samples = samples
    seek.trajectory = TRAJECTORIES.index(trajectory)
    seek.duration = samples * sample_time
    if trajectory != 'time_optimal' or samples == 0:
        return
    segments = time_optimal_segments(abs(distance), bounds)
    stretch = seek.duration / segments.duration
    jerk_time, acceleration_time, cruise_time = (stretch * time for time in segments)
    seek.jerk_time = jerk_time
    seek.acceleration_time = acceleration_time
    seek.acceleration = distance / (
        (jerk_time + acceleration_time) * (2.0 * jerk_time + acceleration_time + cruise_time)
    )


@compiled
def _minimum_jerk(distance: float, duration: float, t: float) -> tuple[float, float, float]:
    """Return distance covered [um], velocity [um/s] and acceleration [um/s^2] at ``t`` [s] in the first half."""
    s = t / duration
    square = s * s
    return (
        distance * (square * s * (10.0 + s * (6.0 * s - 15.0))),
        distance / duration * (30.0 * square * (1.0 + s * (s - 2.0))),
        distance / (duration * duration) * (60.0 * s * (1.0 + s * (2.0 * s - 3.0))),
    )


@compiled
def _time_optimal(c: np.record, t: float, nudge: float) -> tuple[float, float, float]:
    """Return the same values as :func:`_minimum_jerk`; ``nudge`` [s] is added to the time that selects the segment."""
    acceleration, rise, stay = c.acceleration, c.jerk_time, c.acceleration_time
    at = t + nudge
    if at < rise:
        jerk = acceleration / rise
        return jerk * t * t * t / 6.0, 0.5 * jerk * t * t, jerk * t
    if at < rise + stay:
        after = t - rise
        velocity = acceleration * (0.5 * rise + after)
        return acceleration * (rise * rise / 6.0 + 0.5 * after * (rise + after)), velocity, acceleration
    full = 2.0 * rise + stay
    velocity = acceleration * (rise + stay)
    if at < full:
        jerk = acceleration / rise
        left = full - t
        covered = velocity * (0.5 * full - left) + jerk * left * left * left / 6.0
        return covered, velocity - 0.5 * jerk * left * left, jerk * left
    return velocity * (t - 0.5 * full), velocity, 0.0


@compiled
def trajectory_at(c: np.record, sample: int, sample_time: float) -> tuple[float, float, float]:
    """
    Return position [um], velocity [um/s] and acceleration [um/s^2] of a seek.

    Parameters
    ----------
    c
        Record with the layout :data:`SEEK`.
    sample
        Samples since the start of the seek, at least 0; after the last sample the target is held.
    sample_time
        T [s].
    """
    samples = int(c.samples)
    if sample >= samples:
        return c.target, 0.0, 0.0
    # The second half mirrors the first half, so both ends are exact.
    is_second = 2 * sample >= samples
    t = float(samples - sample if is_second else sample) * sample_time
    duration = c.duration
    if int(c.trajectory) == Trajectory.MINIMUM_JERK:
        covered, velocity, acceleration = _minimum_jerk(c.target - c.origin, duration, t)
    else:
        nudge = _SEGMENT_TOLERANCE * duration
        # A sample at a boundary belongs to the later segment, in the mirrored half too.
        covered, velocity, acceleration = _time_optimal(c, t, -nudge if is_second else nudge)
    if is_second:
        return c.target - covered, velocity, -acceleration
    return c.origin + covered, velocity, acceleration
