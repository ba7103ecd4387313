"""
Metrics of seeks: seek time, settling, residual vibration and effort.

All functions use equally spaced samples, in um, um/s, V and s for a drive in um and V.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.metrics import rms

Array = NDArray[np.float64]

FOLLOW, SEEK, SETTLE = 0, 1, 2
"""The modes of a seek controller, the values of its estimate `seek_mode`."""
_ORDER = np.array([2, 0, 1])
"""Order of the modes within a seek: seek, settle, follow."""
SAMPLES = 4
"""Number of consecutive samples within the tolerance that make an arrival."""
RESIDUAL_TIME = 1e-2
"""Time after arrival that is evaluated as residual vibration [s]."""


@dataclasses.dataclass(frozen=True)
class Seek:
    """
    A change of the target.

    Attributes
    ----------
    row
        Row of the tick at which the target changes.
    origin, target
        The previous and the new target [um].
    """

    row: int
    origin: float
    target: float

    @property
    def length(self) -> float:
        """Length with the sign of the direction [um]."""
        return self.target - self.origin


@dataclasses.dataclass(frozen=True)
class SeekResponse:
    """
    Response of the head to a change of the target, until the next one or the end of the record.

    An undefined time is infinite, another undefined value is nan.

    Attributes
    ----------
    seek
        The seek.
    time
        Time of the change of the target relative to the first row [s].
    watched
        Time until the next seek, or the end of the record [s].
    first_entry
        Time from the change of the target to the first sample within the tolerance [s].
    first_arrival
        The same to the first of a number of consecutive samples within it, for which a drive waits before it reads or
        writes.
    seek_time
        The same, if no later sample leaves the tolerance until the next seek or for a given time.
    settling_time
        Time from the mode change from seek to settle to the final arrival [s], 0 if the head arrived before it; from
        the first entry if the modes are unknown, or did not change so.
    overshoot
        Overshoot beyond the target until the end of the residual vibration [um], at least 0; until the next seek if the
        head does not arrive.
    residual_peak, residual_rms
        Peak of the position error in the residual vibration, and its rms about its mean [um].
    residual_frequency
        Frequency of its largest spectral line, without mean and trend [Hz].
    peak_control, rms_control
        Peak and rms command from the change of the target to the final arrival, or to the next seek [V]. The squared
        rms is proportional to the mean heat in the coil.
    peak_jerk, rms_jerk
        Peak and rms jerk of the head over the same time [um/s^3].
    """

    seek: Seek
    time: float
    watched: float
    first_entry: float
    first_arrival: float
    seek_time: float
    settling_time: float
    overshoot: float
    residual_peak: float
    residual_rms: float
    residual_frequency: float
    peak_control: float
    rms_control: float
    peak_jerk: float
    rms_jerk: float

    @property
    def has_arrived(self) -> bool:
        """Whether the head arrived and stayed."""
        return self.seek_time < math.inf


def find_seeks(position: ArrayLike, velocity: ArrayLike, along_trajectory: bool) -> list[Seek]:
    """
    Return the seeks of a reference that is constant between them.

    A seek whose trajectory is not complete in the record is omitted, since the reference does not show its target.

    Parameters
    ----------
    position, velocity
        x_d [um] and dx_d/dt [um/s], shape (n,).
    along_trajectory
        Whether x_d moves along a trajectory, which is still at its origin at the tick of the change, or steps.
    """
    x_d, v_d = np.asarray(position, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    changes = np.flatnonzero(np.diff(x_d) != 0.0) + 1
    found: list[Seek] = []
    first: int | None = None
    for row in changes.tolist():
        first = row if first is None else first
        if v_d[row] == 0.0:
            found.append(Seek(max(first - 1, 0) if along_trajectory else first, float(x_d[first - 1]), float(x_d[row])))
            first = None
    return found


def targets_over_time(seeks: Sequence[Seek], first: float, rows: int) -> Array:
    """Return the target at each row [um], shape (rows,); ``first`` is the target before the first seek."""
    target = np.full(rows, seeks[0].origin if seeks else first)
    for seek in seeks:
        target[seek.row :] = seek.target
    return target


def seek_responses(
    seeks: Sequence[Seek],
    position: ArrayLike,
    velocity: ArrayLike,
    control: ArrayLike,
    sample_time: float,
    tolerance: float,
    *,
    modes: ArrayLike | None = None,
    samples: int = SAMPLES,
    stay: float | None = None,
) -> list[SeekResponse]:
    """
    Return the responses to seeks.

    Parameters
    ----------
    seeks
        Seeks in row order, at most one per row.
    position, velocity
        Position and velocity of the head [um, um/s], shape (n,); relative to a moving track center.
    control
        Command u, held from each sample on [V], shape (n,).
    sample_time
        Sample time T [s].
    tolerance
        Largest position error on target [um].
    modes
        Mode of the controller at each sample, shape (n,), if it is known.
    samples
        Number of consecutive samples within the tolerance that make an arrival.
    stay
        Time after the arrival in which the head may not leave the tolerance [s]; None until the next seek. A record or
        seek that ends earlier is judged by its available samples.

    Raises
    ------
    ValueError
        If shapes differ, rows are not ascending within the record, or a number is out of range.
    """
    x, v, u = (np.asarray(values, dtype=np.float64) for values in (position, velocity, control))
    mode = None if modes is None else np.asarray(modes)
    if x.ndim != 1 or not x.shape == v.shape == u.shape or (mode is not None and mode.shape != x.shape):
        raise ValueError(f'arrays of different shape: {x.shape}, {v.shape}, {u.shape}')
    rows = [seek.row for seek in seeks]
    if any(late <= early for early, late in zip([-1, *rows], [*rows, len(x)], strict=True)):
        raise ValueError(f'invalid rows of seeks: {rows}; expected ascending rows from 0 to {len(x) - 1}')
    if not tolerance > 0.0:
        raise ValueError(f'invalid tolerance of a seek: {tolerance:g}; expected above 0')
    if samples < 1:
        raise ValueError(f'invalid number of samples of an arrival: {samples}; expected at least 1')
    if stay is not None and not stay >= 0.0:
        raise ValueError(f'invalid time on target: {stay:g} s; expected at least 0')
    watched = None if stay is None else math.ceil(stay / sample_time - 1e-9)
    return [
        _Part(
            seek,
            x[seek.row : end],
            v[seek.row : end],
            u[seek.row : end],
            None if mode is None else mode[seek.row : end],
            sample_time,
        ).response(tolerance, samples, watched)
        for seek, end in zip(seeks, [*rows, len(x)][1:], strict=True)
    ]


@dataclasses.dataclass(frozen=True)
class _Part:
    """The samples of one seek, until the next one."""

    seek: Seek
    position: Array
    velocity: Array
    control: Array
    mode: NDArray[np.generic] | None
    sample_time: float

    def response(self, tolerance: float, samples: int, watched: int | None) -> SeekResponse:
        """Return the response; ``watched`` is the number of samples to stay, None for all."""
        error, count = self.position - self.seek.target, len(self.position)
        # A position that is not finite is outside any tolerance.
        inside = np.abs(error) <= tolerance
        entry = int(inside.argmax()) if inside.any() else None
        first, last = _arrival(inside, samples, samples), _arrival(inside, samples, watched)
        end = count if last is None else last
        late = end if last is None else min(count, last + math.ceil(RESIDUAL_TIME / self.sample_time - 1e-9))
        residual = error[end:late]
        beyond = math.copysign(1.0, self.seek.length) * error[:late]
        before = slice(0, max(end, 1))
        # The command at the arrival acts only after it.
        control, jerk = self.control[before], self._jerk(end)
        return SeekResponse(
            seek=self.seek,
            time=self.seek.row * self.sample_time,
            watched=count * self.sample_time,
            first_entry=self._seconds(entry),
            first_arrival=self._seconds(first),
            seek_time=self._seconds(last),
            settling_time=self._settling(entry, last),
            overshoot=max(0.0, float(beyond.max())) if np.isfinite(beyond).all() else math.inf,
            residual_peak=float(np.abs(residual).max()) if len(residual) else math.nan,
            residual_rms=rms(residual - residual.mean()) if len(residual) else math.nan,
            residual_frequency=_largest_line(residual, self.sample_time),
            peak_control=float(np.abs(control).max()),
            rms_control=rms(control),
            peak_jerk=float(np.abs(jerk).max()) if len(jerk) else math.nan,
            rms_jerk=rms(jerk) if len(jerk) else math.nan,
        )

    def _seconds(self, samples: int | None) -> float:
        return math.inf if samples is None else samples * self.sample_time

    def _settling(self, entry: int | None, arrival: int | None) -> float:
        if arrival is None or entry is None:
            return math.inf
        begin = entry
        if self.mode is not None:
            switches = np.flatnonzero((self.mode[:-1] == SEEK) & (self.mode[1:] == SETTLE)) + 1
            begin = int(switches[0]) if len(switches) else entry
        return max(0, arrival - begin) * self.sample_time

    def _jerk(self, end: int) -> Array:
        """Return the head's jerk until a sample [um/s^3], as the second difference of its velocity."""
        return np.asarray(np.diff(self.velocity[: end + 1], 2) / self.sample_time**2)


def _arrival(inside: NDArray[np.bool_], samples: int, watched: int | None) -> int | None:
    """
    Return the first sample from which on all are inside; None if no sample is.

    Parameters
    ----------
    inside
        Whether each sample is within the tolerance, shape (n,).
    samples
        Smallest number of samples inside.
    watched
        Number of samples that must stay inside, if available; None for all later samples.
    """
    count = len(inside)
    # Number of samples inside from each sample on, until the next one outside.
    outside = np.append(np.flatnonzero(~inside), count)
    lasts = outside[np.searchsorted(outside, np.arange(count))] - np.arange(count)
    to_end = count - np.arange(count)
    wanted = to_end if watched is None else np.minimum(max(watched, samples), to_end)
    arrived = np.flatnonzero((lasts >= wanted) & (lasts >= samples))
    return int(arrived[0]) if len(arrived) else None


def residual_spectrum(error: ArrayLike, sample_time: float) -> tuple[Array, Array]:
    """
    Return frequencies [Hz] and the amplitude of a sine at each of them, for a short record without its linear trend.

    One Hann window covers the whole record, so that the lines are 1/(n T) apart. A sine between two lines appears up to
    15 % too small. The line at 0 is omitted.

    Parameters
    ----------
    error
        Position error, shape (n,), n at least 4.
    sample_time
        Sample time T [s].

    Raises
    ------
    ValueError
        If the record has fewer than four samples.
    """
    y = np.asarray(error, dtype=np.float64)
    if len(y) < 4:
        raise ValueError(f'a spectrum needs at least 4 samples; the record has {len(y)}')
    index = np.arange(len(y)) - 0.5 * (len(y) - 1)
    y = y - y.mean()
    y = y - index * (float(index @ y) / float(index @ index))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(len(y)) / len(y))
    amplitudes = 2.0 * np.abs(np.fft.rfft(window * y)) / window.sum()
    if len(y) % 2 == 0:
        # The line at the Nyquist frequency has no mirror image.
        amplitudes[-1] *= 0.5
    frequencies = np.fft.rfftfreq(len(y), sample_time)
    return np.asarray(frequencies[1:], dtype=np.float64), np.asarray(amplitudes[1:], dtype=np.float64)


def _largest_line(error: Array, sample_time: float) -> float:
    """Return the frequency of the largest line of a residual vibration [Hz]; nan if it is too short."""
    if len(error) < 4 or not np.isfinite(error).all():
        return math.nan
    frequencies, amplitudes = residual_spectrum(error, sample_time)
    return float(frequencies[int(amplitudes.argmax())])


def returns_to_earlier_modes(modes: ArrayLike, seeks: Sequence[Seek]) -> list[int]:
    """
    Return the rows where a controller returned to an earlier mode within a seek.

    The order within a seek is seek, settle, follow, where modes may be missing. The mode at the change of the target
    may last for a while.

    Parameters
    ----------
    modes
        Mode at each sample, shape (n,).
    seeks
        Seeks in row order.
    """
    mode = np.asarray(modes).astype(np.int64)
    found: list[int] = []
    for seek, end in zip(seeks, [*(seek.row for seek in seeks), len(mode)][1:], strict=True):
        part = mode[seek.row : end]
        begin = 0
        if seek.row > 0:
            changed = np.flatnonzero(part != mode[seek.row - 1])
            begin = int(changed[0]) if len(changed) else len(part)
        back = np.flatnonzero(np.diff(_ORDER[part[begin:]]) < 0)
        found += [seek.row + begin + 1 + int(row) for row in back]
    return found


@dataclasses.dataclass(frozen=True)
class AccessTimes:
    """
    Seek times of the seeks in a range of lengths.

    Attributes
    ----------
    shortest, longest
        Shortest and longest seek [um].
    count, arrived
        Number of seeks, and of seeks that arrived.
    median, worst
        Median and largest seek time [s]; infinite if too many seeks do not arrive.
    """

    shortest: float
    longest: float
    count: int
    arrived: int
    median: float
    worst: float


def access_times(responses: Sequence[SeekResponse]) -> list[AccessTimes]:
    """Return seek times by length; the ranges start at 1, 2 and 5 times powers of ten, empty ones are omitted."""
    lengths = np.array([abs(response.seek.length) for response in responses])
    times = np.array([response.seek_time for response in responses])
    # A length just below an edge because of rounding belongs to that range.
    ranges = np.array([_range_of(length * (1.0 + 1e-9)) for length in lengths.tolist()], dtype=np.int64)
    found = []
    for index in np.unique(ranges):
        chosen = ranges == index
        part = times[chosen]
        # The mean of the two middle values would be nan if both are infinite.
        ordered = np.sort(part)
        low, high = float(ordered[(len(part) - 1) // 2]), float(ordered[len(part) // 2])
        median = 0.5 * (low + high) if high < math.inf else high
        found.append(
            AccessTimes(
                float(lengths[chosen].min()),
                float(lengths[chosen].max()),
                len(part),
                int(np.isfinite(part).sum()),
                median,
                float(ordered[-1]),
            )
        )
    return found


def _range_of(length: float) -> int:
    """Return the number of the range of a length: 0 from 1 µm, 1 from 2 µm, 2 from 5 µm, 3 from 10 µm on."""
    decade = math.floor(math.log10(length))
    leading = length / 10.0**decade
    return 3 * decade + (0 if leading < 2.0 else 1 if leading < 5.0 else 2)
