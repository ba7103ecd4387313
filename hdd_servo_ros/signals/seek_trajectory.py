"""
Trajectories of a seek, from rest to rest: their duration under bounds, and position and derivatives at a time.

The minimum-jerk trajectory is the polynomial of degree 5 with velocity and acceleration 0 at both ends (Flash, Hogan,
Journal of Neuroscience 5, 1985). The time-optimal one has constant jerk, acceleration or velocity at its bound in each
of at most seven segments, symmetric about its middle.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp, log
from hdd_servo_ros.numerics.records import layout


class Trajectory(IntEnum):
    """The trajectories by the number that compiled code knows them by."""

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
A seek: its start [tick of the list], the samples and time [s] of its trajectory, where it comes from and goes to [um].
The rest is of the time-optimal trajectory: time [s] in which the acceleration rises, time for which it stays at its
largest, and that largest one [um/s^2], with the sign of the seek.
"""

_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Of the minimum-jerk trajectory of length 1 and duration 1."""
_PEAK_JERK = 60.0
_PEAK_VELOCITY = 1.875

_SEGMENT_TOLERANCE = 1e-9
"""
Part of the duration by which a time may miss the end of a segment and still be taken at that end: as with the edges of
a square, rounding must not decide on which sample the acceleration of a trajectory without bound on jerk changes.
"""


class Bounds(NamedTuple):
    """What a trajectory may not exceed: acceleration [um/s^2], jerk [um/s^3] and velocity [um/s], 0 for no bound."""

    acceleration: float
    jerk: float = 0.0
    velocity: float = 0.0


class Segments(NamedTuple):
    """
    The segments of a time-optimal trajectory.

    The acceleration rises for ``jerk_time``, stays for ``acceleration_time``, falls for ``jerk_time``; the velocity
    stays for ``cruise_time``; and the first three follow with the other sign. All in s.
    """

    jerk_time: float
    acceleration_time: float
    cruise_time: float

    @property
    def duration(self) -> float:
        """The duration of the trajectory [s]."""
        return 2.0 * (2.0 * self.jerk_time + self.acceleration_time) + self.cruise_time


def cube_root(x: float) -> float:
    """Return the cube root of x >= 0, to the same bits on every machine."""
    if x <= 0.0:
        return 0.0
    root: float = exp(log(x) / 3.0)
    # One step of Newton's method takes away the error that the logarithm's rounding makes.
    return root - (root - x / (root * root)) / 3.0


def time_optimal_segments(length: float, bounds: Bounds) -> Segments:
    """Return the segments of the fastest trajectory over a length [um], at least 0, that keeps all bounds."""
    acceleration, jerk, velocity = bounds
    if length <= 0.0:
        return Segments(0.0, 0.0, 0.0)
    rise = acceleration / jerk if jerk > 0.0 else 0.0
    if length < 2.0 * acceleration * rise * rise:
        # Too short to reach the bound on acceleration: L = 2 j t^3.
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
    """Return the least duration [s] of a trajectory over a length [um], at least 0, that keeps all bounds."""
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
    Complete a record of the layout :data:`SEEK` that has origin and target.

    Parameters
    ----------
    seek
        The record.
    trajectory
        One of :data:`TRAJECTORIES`.
    bounds
        What it may not exceed.
    samples
        Its duration in samples, at least :func:`trajectory_time` long: it is stretched to that.
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
    """Return distance covered [um], velocity [um/s] and acceleration [um/s^2] at ``t`` [s], up to the middle."""
    s = t / duration
    square = s * s
    return (
        distance * (square * s * (10.0 + s * (6.0 * s - 15.0))),
        distance / duration * (30.0 * square * (1.0 + s * (s - 2.0))),
        distance / (duration * duration) * (60.0 * s * (1.0 + s * (2.0 * s - 3.0))),
    )


@compiled
def _time_optimal(c: np.record, t: float, nudge: float) -> tuple[float, float, float]:
    """Return what :func:`_minimum_jerk` returns; ``nudge`` [s] is added to the time that decides on the segment."""
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
        Record of the layout :data:`SEEK`.
    sample
        Samples since its start, at least 0; from its last sample on the target is held.
    sample_time
        T [s].
    """
    samples = int(c.samples)
    if sample >= samples:
        return c.target, 0.0, 0.0
    # The second half is the first one backwards: both ends are met without rounding.
    is_second = 2 * sample >= samples
    t = float(samples - sample if is_second else sample) * sample_time
    duration = c.duration
    if int(c.trajectory) == Trajectory.MINIMUM_JERK:
        covered, velocity, acceleration = _minimum_jerk(c.target - c.origin, duration, t)
    else:
        nudge = _SEGMENT_TOLERANCE * duration
        # A segment begins with its first sample, backwards too.
        covered, velocity, acceleration = _time_optimal(c, t, -nudge if is_second else nudge)
    if is_second:
        return c.target - covered, velocity, -acceleration
    return c.origin + covered, velocity, acceleration
