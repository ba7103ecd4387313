"""Seek times over seek length, by method."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.seek.cases import BASE, PID
from hdd_servo_ros.studies.seek.trials import Measures, SeekTrial, measured, of_length, seek_trial

DWELL = 0.06
"""Time between seeks, long enough for the slowest method [s]."""
WIDE_FROM = 200.0
"""Seek length above which the vibrometer uses larger scales [um]."""
_WIDE = {'ldv_sensor:displacement_scale': 200.0, 'ldv_sensor:velocity_scale': 1.5e5}
_TRAJECTORY = {
    'reference_generator:seek.trajectory': 'minimum_jerk',
    'reference_generator:seek.acceleration': 3.5e8,
    'reference_generator:seek.jerk': 3e12,
    'pid_controller:acceleration_feedforward': 1.0 / 4.0968e7,
    'pid_controller:velocity_feedforward': 4.6e-6,
}
"""The acceleration leaves a seventh of the voltage for feedback; the feedforward uses the rigid-body model."""


def access_trial(runs: RecordedRuns, method: str, length: float, seed: int) -> SeekTrial:
    """Return six seeks back and forth over a length [um] with a seek method, ``'pid'`` or ``'trajectory'``."""
    changes: dict[str, object] = dict(_WIDE) if length > WIDE_FROM else {}
    case = BASE.get(method, PID)
    if method == 'trajectory':
        changes.update(_TRAJECTORY)
    return seek_trial(runs, case, [length, 0.0, -length, 0.0, length, 0.0], seed, changes, DWELL)


def access_measures(
    runs: RecordedRuns, methods: Sequence[str], lengths: Sequence[float], seeds: int
) -> dict[tuple[str, float], Measures]:
    """Return the measures of the seeks of each method and length."""
    keys = [(method, length) for method in methods for length in lengths]
    due = [access_trial(runs, *key, seed) for key in keys for seed in range(1, seeds + 1)]
    found = measured(due, 'access times').reshape(len(keys), -1)
    return {key: of_length(part, key[1]) for key, part in zip(keys, found, strict=True)}


def median_and_worst(times: NDArray[np.float64]) -> str:
    """Return median and largest time as tables show them [ms]."""
    return ' / '.join('none' if np.isinf(value) else f'{value:.2f}' for value in (np.median(times), times.max()))
