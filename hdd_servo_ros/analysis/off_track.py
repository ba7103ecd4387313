"""Time off track, and the response to shocks: how far the head leaves the track, and for how long."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.messages.ticks import HALF_MICROSECOND

WRITE_LIMIT = 0.10
"""Largest position error before a write, as a fraction of the track pitch (Mamun, Guo, Bi: Hard Disk Drive)."""
READ_LIMIT = 0.15
"""The same before a read."""
SHOCK_LEVEL = 50.0
"""Linear acceleration of the base from which on it counts as a shock [m/s^2]: 5 g, above vibration."""
QUIET_TIME = 0.02
"""Time below that level after which another shock may begin [s]; a half-sine of 11 ms with its rebound is shorter."""


@dataclasses.dataclass(frozen=True)
class OffTrack:
    """How much of a record is off track: share of its samples, and the longest stretch of consecutive ones [s]."""

    fraction: float
    longest: float


def off_track(error: ArrayLike, limit: float, sample_time: float) -> OffTrack:
    """
    Return how long a position error is beyond a limit.

    Parameters
    ----------
    error
        Position error, shape (n,), n at least 1.
    limit
        Largest magnitude on track, in the unit of the error.
    sample_time
        T [s].

    Raises
    ------
    ValueError
        If there is no sample.
    """
    # What is not a number is beyond any limit.
    beyond = ~(np.abs(np.asarray(error, dtype=np.float64)) <= limit)
    if not len(beyond):
        raise ValueError('no sample after the transient')
    edges = np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max()) if len(edges) else 0
    return OffTrack(float(beyond.mean()), longest * sample_time)


@dataclasses.dataclass(frozen=True)
class ShockResponse:
    """
    The response to one shock.

    Attributes
    ----------
    time
        Begin of the shock [s].
    peak
        Largest magnitude of the position error until the next shock, in its unit.
    outside
        Time for which the magnitude exceeds the band [s].
    recovery
        Time from the begin of the shock until the error stays within the band [s]; 0 if it never leaves it, infinite
        if it is outside at the last sample.
    """

    time: float
    peak: float
    outside: float
    recovery: float


def shock_times(acceleration: ArrayLike, sample_time: float, level: float = SHOCK_LEVEL) -> NDArray[np.float64]:
    """
    Return when shocks begin [s], from the first sample on.

    A shock begins where the magnitude first exceeds the level after :data:`QUIET_TIME` below it.

    Parameters
    ----------
    acceleration
        Of the base [m/s^2], shape (n,).
    sample_time
        T [s].
    level
        From which magnitude on it counts as a shock [m/s^2].
    """
    rows = np.flatnonzero(np.abs(np.asarray(acceleration, dtype=np.float64)) > level)
    apart = np.diff(rows, prepend=-np.inf) * sample_time > QUIET_TIME
    return np.asarray(rows[apart] * sample_time)


def shock_responses(time: ArrayLike, error: ArrayLike, shocks: Sequence[float], band: float) -> list[ShockResponse]:
    """
    Return the responses to shocks, each until the next one or the end of the record.

    Parameters
    ----------
    time, error
        Time [s] and position error of the samples, equally spaced, shape (n,).
    shocks
        When the shocks begin [s], ascending.
    band
        Half width of the band in which the head counts as recovered, in the unit of the error.

    Raises
    ------
    ValueError
        If a shock is not within the record, or they are not in ascending order.
    """
    t, magnitude = np.asarray(time, dtype=np.float64), np.abs(np.asarray(error, dtype=np.float64))
    if t.shape != magnitude.shape or len(t) < 2:
        raise ValueError(f'time and error of one shape (n,), n at least 2, are needed: {t.shape}, {magnitude.shape}')
    sample_time = float(t[-1] - t[0]) / (len(t) - 1)
    rows = np.searchsorted(t, np.asarray(shocks, dtype=np.float64) - HALF_MICROSECOND)
    for shock, row in zip(shocks, rows, strict=True):
        if row >= len(t) or shock < t[0] - HALF_MICROSECOND:
            raise ValueError(f'no shock response at {shock:g} s: the record goes from {t[0]:g} to {t[-1]:g} s')
    if np.any(np.diff(rows) <= 0):
        raise ValueError(f'shock times must be ascending, each on a sample of its own: {list(shocks)}')
    found = []
    for row, end in zip(rows, [*rows[1:], len(t)], strict=True):
        part = magnitude[row:end]
        outside = np.flatnonzero(~(part <= band))
        last = int(outside[-1]) + 1 if len(outside) else 0
        recovery = last * sample_time if last < len(part) else float('inf')
        found.append(ShockResponse(float(t[row]), float(part.max()), len(outside) * sample_time, recovery))
    return found
