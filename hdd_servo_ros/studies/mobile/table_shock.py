"""Table: peak error and time off track after shocks of 63 g and 300 g."""

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import (
    CONTROLLERS,
    GAIN_ERRORS,
    METHODS,
    SHOCK,
    SHOCK_DURATION,
    Limits,
    method_of,
)
from hdd_servo_ros.studies.mobile.shock_measures import BEFORE, LIMIT, peak_and_time
from hdd_servo_ros.studies.mobile.trials import Trial, count, on_trials, quantile, trial
from hdd_servo_ros.studies.output import write_table

SEEDS = 10
PEAK, OUTSIDE = Limits(110.0), Limits(0.5, unit='ms')
"""Limits with PID and fixed feedforward at 63 g."""
CASES = tuple(cases['fixed'] for by_controller in SHOCK.values() for cases in by_controller.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with other methods, gains and seeds, and write a row per shock, controller, method."""
    due = {
        (level, controller, method): [
            _with_shock(runs, level, controller, method, gain_error, seed)
            for gain_error in (GAIN_ERRORS if method != 'none' else GAIN_ERRORS[:1])
            for seed in range(1, SEEDS + 1)
        ]
        for level, by_controller in SHOCK.items()
        for controller in by_controller
        for method in METHODS
    }
    found = on_trials(_measure, [each for trials in due.values() for each in trials], 'shock', chunksize=8)
    parts = np.split(found, np.cumsum([len(trials) for trials in due.values()])[:-1])
    rows = []
    for (level, controller, method), part in zip(due, parts, strict=True):
        has_limit = (level, controller, method) == (63.0, 'pid', 'fixed')
        within = count((part[:, 0] <= PEAK.high) & (part[:, 1] <= OUTSIDE.high + 1e-9)) if has_limit else ''
        limit = f'{PEAK}, {OUTSIDE}' if has_limit else ''
        rows.append((f'{level:g} g', CONTROLLERS[controller], method, *_cells(part), limit, within))
    header = (
        'shock',
        'controller',
        'feedforward',
        'peak [nm]',
        f'time beyond {LIMIT:g} nm [ms]',
        'limit',
        'runs within the limit',
    )
    title = (
        'Half-sine of 2 ms, imbalance 2 %, accelerometers of 3 kHz: peak error of the head, and time beyond '
        f'{LIMIT:g} nm; median / 95th percentile over {SEEDS} seeds and accelerometer gain errors of -12.5 % and '
        '+12.5 %.'
    )
    return write_table(path, title, header, rows)


def _with_shock(runs: RecordedRuns, level: float, controller: str, method: str, gain_error: float, seed: int) -> Trial:
    case = SHOCK[level][controller]['fixed']
    changes = {method_of(controller): method, 'accelerometer:gain_error': gain_error}
    start = float(runs.parameters(case)['disturbance_generator']['shock.time'])
    made = trial(runs, case, seed, changes)
    return dataclasses.replace(made, duration=SHOCK_DURATION, transient=start - BEFORE)


def _measure(shaken: Trial) -> tuple[float, float]:
    return peak_and_time(shaken.error(), shaken.sample_time)


def _cells(part: NDArray[np.float64]) -> tuple[str, str]:
    peak, outside = part.T
    peaks = f'{quantile(peak, 0.5):.0f} / {quantile(peak, 0.95):.0f}'
    return peaks, f'{quantile(outside, 0.5):.1f} / {quantile(outside, 0.95):.1f}'
