"""Time off track, and the response of the head to shocks."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.messages.ticks import HALF_MICROSECOND

WRITE_LIMIT = 0.10
"""Largest position error for writing, as a fraction of the track pitch (Mamun, Guo, Bi: Hard Disk Drive)."""
READ_LIMIT = 0.15
"""The same for reading."""
SHOCK_LEVEL = 50.0
"""Smallest linear acceleration of a shock of the base [m/s^2]: 5 g, above vibration."""
QUIET_TIME = 0.02
"""Time below that level before another shock [s]; a half-sine of 11 ms with its rebound is shorter."""


@dataclasses.dataclass(frozen=True)
class OffTrack:
    """Off-track part of a record: fraction of its samples, and longest consecutive time [s]."""

    fraction: float
    longest: float


def off_track(error: ArrayLike, limit: float, sample_time: float) -> OffTrack:
    """
    Return the time that a position error exceeds a limit.

    Parameters
    ----------
    error
        Position error, shape (n,), n at least 1.
    limit
        Largest error on track, in the unit of the error.
    sample_time
        Sample time T [s].

    Raises
    ------
    ValueError
        If the error has no samples.
    """
    # nan exceeds any limit.
    beyond = ~(np.abs(np.asarray(error, dtype=np.float64)) <= limit)
    if not len(beyond):
        raise ValueError('no samples after the transient')
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
        Start of the shock [s].
    peak
        Peak of the position error until the next shock, in its unit.
    outside
        Time for which the magnitude exceeds the band [s].
    recovery
        Time from the start of the shock until the error stays within the band [s]; 0 if it never leaves the band,
        infinite if it is outside at the last sample.
    """

    time: float
    peak: float
    outside: float
    recovery: float


def shock_times(acceleration: ArrayLike, sample_time: float, level: float = SHOCK_LEVEL) -> NDArray[np.float64]:
    """
    Return the start times of shocks [s], relative to the first sample.

    A shock starts when the magnitude first exceeds the level after :data:`QUIET_TIME` below it.

    Parameters
    ----------
    acceleration
        Acceleration of the base [m/s^2], shape (n,).
    sample_time
        Sample time T [s].
    level
        Smallest magnitude of a shock [m/s^2].
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
        Start times of the shocks [s], ascending.
    band
        Half width of the recovery band, in the unit of the error.

    Raises
    ------
    ValueError
        If a shock is not within the record, or the times are not ascending.
    """
    t, magnitude = np.asarray(time, dtype=np.float64), np.abs(np.asarray(error, dtype=np.float64))
    if t.shape != magnitude.shape or len(t) < 2:
        raise ValueError(f'expected time and error of the same shape (n,), n at least 2: {t.shape}, {magnitude.shape}')
    sample_time = float(t[-1] - t[0]) / (len(t) - 1)
    rows = np.searchsorted(t, np.asarray(shocks, dtype=np.float64) - HALF_MICROSECOND)
    for shock, row in zip(shocks, rows, strict=True):
        if row >= len(t) or shock < t[0] - HALF_MICROSECOND:
            raise ValueError(f'no shock response at {shock:g} s: the record spans {t[0]:g} to {t[-1]:g} s')
    if np.any(np.diff(rows) <= 0):
        raise ValueError(f'shock times must be ascending, at most one per sample: {list(shocks)}')
    found = []
    for row, end in zip(rows, [*rows[1:], len(t)], strict=True):
        part = magnitude[row:end]
        outside = np.flatnonzero(~(part <= band))
        last = int(outside[-1]) + 1 if len(outside) else 0
        recovery = last * sample_time if last < len(part) else float('inf')
        found.append(ShockResponse(float(t[row]), float(part.max()), len(outside) * sample_time, recovery))
    return found
