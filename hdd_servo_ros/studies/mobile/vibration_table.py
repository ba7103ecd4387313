"""Table of 3 sigma in rotational vibration over methods, sensors and controllers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import (
    BANDWIDTHS,
    CONTROLLERS,
    GAIN_ERRORS,
    METHODS,
    NO_VIBRATION_LIMITS,
    VIBRATION_LIMITS,
    Limits,
    method_of,
)
from hdd_servo_ros.studies.mobile.trials import Trial, count, median_and_tail, on_trials, trial
from hdd_servo_ros.studies.output import write_table

NETWORK_RATIO = 1.1
"""Limit of the 3 sigma with the network relative to that of fxlms in the same run."""
_NO_VIBRATION = 'no vibration'
Key = tuple[str, float]
"""Method, and bandwidth of the accelerometers [Hz], 0 if they are not used."""


def rows_of(methods: tuple[str, ...] = METHODS) -> tuple[Key, ...]:
    """Return the keys of the rows of the table."""
    own = ((method, bandwidth) for method in methods if method != 'none' for bandwidth in BANDWIDTHS)
    return ((_NO_VIBRATION, 0.0), ('none', 0.0), *own)


def changes_of(controller: str, key: Key) -> list[dict[str, object]]:
    """Return the overrides of a row, one set for each gain error of the accelerometers."""
    method, bandwidth = key
    if method == _NO_VIBRATION:
        return [{method_of(controller): 'none', 'disturbance_generator:vibration.rotational.enabled': False}]
    if method == 'none':
        return [{method_of(controller): 'none'}]
    own = {method_of(controller): method, 'accelerometer:bandwidth': bandwidth}
    return [{**own, 'accelerometer:gain_error': gain_error} for gain_error in GAIN_ERRORS]


def three_sigma(
    runs: RecordedRuns, cases: Mapping[str, Case], keys: tuple[Key, ...], seeds: int
) -> dict[tuple[str, Key], NDArray[np.float64]]:
    """
    Return 3 sigma of all runs of each controller and row [nm].

    Parameters
    ----------
    runs
        Runs of the study.
    cases
        Recorded run in vibration for each controller; the other runs differ from it in a few parameters.
    keys
        Keys of the rows.
    seeds
        Number of seeds.

    Returns
    -------
    dict
        By controller and row, an array of shape (gain errors, seeds) with one column per seed.
    """
    due = {
        (controller, key): [
            trial(runs, case, seed, changes) for changes in changes_of(controller, key) for seed in range(1, seeds + 1)
        ]
        for controller, case in cases.items()
        for key in keys
    }
    found = on_trials(Trial.three_sigma, [each for trials in due.values() for each in trials], 'vibration')
    parts = np.split(found, np.cumsum([len(trials) for trials in due.values()])[:-1])
    return {key: part.reshape(-1, seeds) for key, part in zip(due, parts, strict=True)}


def write_vibration(
    runs: RecordedRuns, path: Path, title: str, cases: Mapping[str, Case], seeds: int, with_limits: bool = True
) -> Path:
    """
    Write one row per method and bandwidth of the accelerometers, and return the file.

    Parameters
    ----------
    runs, path
        See :meth:`~hdd_servo_ros.studies.chapter.Figure.make`.
    title
        Title of the table.
    cases, seeds
        See :func:`three_sigma`.
    with_limits
        Whether the limits apply to these runs.
    """
    keys = rows_of()
    found = three_sigma(runs, cases, keys, seeds)
    rows: list[tuple[Any, ...]] = []
    for key in keys:
        pid, nn = (found[controller, key] for controller in CONTROLLERS)
        method, bandwidth = key
        cells: list[str] = [method, f'{1e-3 * bandwidth:g} kHz' if bandwidth else '', median_and_tail(pid)]
        if with_limits:
            cells += _limit_cells(key, pid, found['pid', ('fxlms', bandwidth)] if method == 'network' else None)
        rows.append((*cells, median_and_tail(nn), count(nn <= pid)))
    limits = ('limit', 'runs within the limit') if with_limits else ()
    header = ('feedforward', 'sensor', 'PID [nm]', *limits, 'adaptive NN [nm]', 'not worse than PID in the same run')
    return write_table(path, title, header, rows)


def _limit_cells(key: Key, pid: NDArray[np.float64], fxlms: NDArray[np.float64] | None) -> tuple[str, str]:
    """Return the limit of a row, and the number of runs within it."""
    method, bandwidth = key
    if fxlms is not None:
        return f'<= {NETWORK_RATIO:g} of fxlms', count(pid <= NETWORK_RATIO * fxlms)
    limit: Limits | None = (
        NO_VIBRATION_LIMITS if method == _NO_VIBRATION else VIBRATION_LIMITS.get((method, bandwidth or 1000.0))
    )
    if limit is None:
        return '', ''
    return str(limit), count((pid >= limit.low) & (pid <= limit.high))
