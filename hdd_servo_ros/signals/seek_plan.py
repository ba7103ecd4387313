"""
Seek list of a reference, planned from its parameters before the run, so that all targets are known in advance.

A seek starts at a tick and takes a whole number of samples.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled_apart
from hdd_servo_ros.numerics.elementary import exp, log
from hdd_servo_ros.numerics.noise import uniform_pair
from hdd_servo_ros.numerics.records import record, size
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.signals.seek_parameters import SeekParameters
from hdd_servo_ros.signals.seek_trajectory import SEEK, Bounds, set_trajectory, trajectory_at, trajectory_time

_STREAM = 48
"""Random number stream; differs from those of instruments and disturbances, which may have the same seed."""

_WHOLE_TOLERANCE = 1e-9
"""Tolerance for rounding up to whole samples [samples]; far above rounding errors."""


@dataclasses.dataclass(frozen=True, eq=False)
class SeekList:
    """
    Seeks of a reference, known in advance.

    Attributes
    ----------
    start_ticks
        Tick of the first start of each seek, shape (n,).
    origins, targets
        Origin and target of each seek [um], including the offset, shape (n,).
    trajectory_ticks
        Duration of the trajectory of each seek [samples], shape (n,); 0 for steps.
    repeat_ticks
        Period of the list [ticks], 0 if it is not repeated. In a repetition, the first seek starts at the last target.
    repeat_trajectory_ticks
        Duration of the trajectory of the first seek in a repetition [samples].
    """

    start_ticks: NDArray[np.int64]
    origins: NDArray[np.float64]
    targets: NDArray[np.float64]
    trajectory_ticks: NDArray[np.int64]
    repeat_ticks: int = 0
    repeat_trajectory_ticks: int = 0

    def __len__(self) -> int:
        return len(self.start_ticks)

    def before(self, tick: int) -> 'SeekList':
        """Return the seeks that start before a tick, including repetitions, as a list without repetition."""
        count = len(self)
        if count == 0:
            return self
        first = int(self.start_ticks[0])
        passes = 1 if self.repeat_ticks == 0 else max(1, -((first - tick) // self.repeat_ticks))
        start_ticks = (self.start_ticks + self.repeat_ticks * np.arange(passes)[:, None]).reshape(-1)
        origins = np.tile(self.origins, passes)
        origins[count::count] = self.targets[-1]
        trajectory_ticks = np.tile(self.trajectory_ticks, passes)
        trajectory_ticks[count::count] = self.repeat_trajectory_ticks
        kept = start_ticks < tick
        return SeekList(start_ticks[kept], origins[kept], np.tile(self.targets, passes)[kept], trajectory_ticks[kept])

    def next_after(self, tick: int) -> tuple[int, float] | None:
        """Return start tick and target [um] of the first seek that starts after a tick, or None without such a seek."""
        if len(self) == 0:
            return None
        passes = 0
        if self.repeat_ticks > 0:
            passes = max(0, (tick - int(self.start_ticks[0])) // self.repeat_ticks)
        index = int(np.searchsorted(self.start_ticks, tick - passes * self.repeat_ticks, side='right'))
        if index == len(self):
            if self.repeat_ticks == 0:
                return None
            index, passes = 0, passes + 1
        return int(self.start_ticks[index]) + passes * self.repeat_ticks, float(self.targets[index])


NO_SEEKS = SeekList(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
"""Seek list of the other waveforms."""


def whole_samples(time: float, sample_time: float) -> int:
    """Return a time [s] in samples of T [s], rounded up with a tolerance for rounding errors."""
    return math.ceil(time / sample_time - _WHOLE_TOLERANCE)


def no_seek_rows() -> NDArray[np.float64]:
    """Return the empty array of seeks for the kernel."""
    return np.zeros((0, size(SEEK)))


def targets_of(seek: SeekParameters) -> list[float]:
    """Return the targets of the list or of the random seeks, relative to the offset [um]."""
    if seek.source == 'list':
        return [seek.track_pitch * target if seek.track_pitch > 0.0 else target for target in seek.targets]
    position = 0.0
    targets = []
    for i in range(seek.count):
        of_length, of_direction = uniform_pair(seek.seed, _STREAM, i)
        if seek.length_distribution == 'uniform':
            length = seek.shortest + of_length * (seek.longest - seek.shortest)
        else:
            length = seek.shortest * exp(of_length * log(seek.longest / seek.shortest))
        # Rounding must not exceed the limits.
        length = min(max(length, seek.shortest), seek.longest)
        forward = length if of_direction < 0.5 else -length
        position = position - forward if abs(position + forward) > seek.travel else position + forward
        position = min(max(position, -seek.travel), seek.travel)
        targets.append(position)
    return targets


def check_dwell_times(seek: SeekParameters) -> None:
    """Check that each seek ends before the next seek starts; raise :class:`ParameterError` otherwise."""
    bounds = _bounds(seek)
    targets = targets_of(seek)
    origins = [0.0, *targets[:-1]]
    times = _times(seek, len(targets))
    seeks = list(zip(origins, targets, times, strict=True))
    if seek.repeat:
        seeks.append((targets[-1], targets[0], times[0]))
    else:
        # The last seek may take any time.
        seeks.pop()
    for i, (origin, target, time) in enumerate(seeks):
        needed = trajectory_time(seek.trajectory, abs(target - origin), bounds)
        if needed > time * (1.0 + _WHOLE_TOLERANCE):
            number = f'seek {i + 1}' if i < len(targets) else 'seek 1 of the repeated list'
            value = seek.dwell_times if len(seek.dwell_times) <= 10 else time
            raise ParameterError(
                'seek.dwell_times',
                value,
                f'at least the duration of each trajectory; {number} over {abs(target - origin):g} um takes '
                f'{needed:g} s within the limits of acceleration, jerk and velocity, but the next seek starts after '
                f'{time:g} s',
            )


def plan(
    seek: SeekParameters, offset: float, start_tick: int, sample_time: float
) -> tuple[SeekList, NDArray[np.float64]]:
    """
    Return the seek list, and its array for the kernel.

    Parameters
    ----------
    seek
        Parameters of the seeks.
    offset
        Offset of the reference [um].
    start_tick
        Start tick of the first seek.
    sample_time
        T [s].

    Returns
    -------
    seeks
        Seek list.
    rows
        One row of layout :data:`~hdd_servo_ros.signals.seek_trajectory.SEEK` per seek, plus one row for the first seek
        of a repetition; ``start`` is relative to the start of the list.
    """
    bounds = _bounds(seek)
    targets = [offset + target for target in targets_of(seek)]
    origins = [offset, *targets]
    dwells = [max(1, whole_samples(time, sample_time)) for time in _times(seek, len(targets))]
    starts = np.concatenate([[0], np.cumsum(dwells)])
    rows = np.zeros((len(targets) + 1, size(SEEK)))
    for i, target in enumerate([*targets, targets[0]]):
        row = record(rows, SEEK, i)
        row.start = starts[i] if i < len(targets) else 0
        row.origin, row.target = origins[i], target
        needed = trajectory_time(seek.trajectory, abs(target - origins[i]), bounds)
        set_trajectory(row, seek.trajectory, bounds, whole_samples(needed, sample_time), sample_time)
    samples = rows.view(SEEK)['samples'].reshape(-1).astype(np.int64)
    seeks = SeekList(
        start_ticks=start_tick + starts[:-1],
        origins=np.array(origins[:-1]),
        targets=np.array(targets),
        trajectory_ticks=samples[:-1],
        repeat_ticks=int(starts[-1]) if seek.repeat else 0,
        repeat_trajectory_ticks=int(samples[-1]) if seek.repeat else 0,
    )
    return seeks, rows


def _bounds(seek: SeekParameters) -> Bounds:
    return Bounds(seek.acceleration, seek.jerk, seek.velocity)


def _times(seek: SeekParameters, count: int) -> Sequence[float]:
    return seek.dwell_times if len(seek.dwell_times) > 1 else seek.dwell_times * count


@compiled_apart
def seek_step(
    rows: NDArray[np.float64], repeat_ticks: int, sample: int, sample_time: float
) -> tuple[float, float, float]:
    """
    Return x_d [um] and its first [um/s] and second [um/s^2] derivatives.

    Parameters
    ----------
    rows
        Array of the seeks from :func:`plan`.
    repeat_ticks
        Period of the list [ticks], 0 if it is not repeated.
    sample
        Samples since the start of the list, at least 0.
    sample_time
        T [s].
    """
    last = len(rows) - 1
    is_over = False
    if repeat_ticks > 0:
        is_over = sample >= repeat_ticks
        sample = sample % repeat_ticks
    # Find the last seek that has started, by bisection.
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if record(rows, SEEK, middle).start <= float(sample):
            low = middle
        else:
            high = middle
    c = record(rows, SEEK, last if is_over and low == 0 else low)
    return trajectory_at(c, sample - int(c.start), sample_time)
