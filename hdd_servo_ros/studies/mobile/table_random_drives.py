"""Table: 200 random drives in rotational vibration, with PID and accelerometers of 1 kHz."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import IN_VIBRATION, TRANSIENT
from hdd_servo_ros.studies.mobile.trials import DURATION, Trial, on_trials, quantile, trial
from hdd_servo_ros.studies.output import write_table

DRIVES = 200
_COMPARED = {method: IN_VIBRATION['pid'][method] for method in ('none', 'fxlms')}
CASES = tuple(_COMPARED.values())
_SHARES = {'5 %': 0.05, 'median': 0.5, '95 %': 0.95, 'worst': 1.0}


def on_random_drives(runs: RecordedRuns, drives: int) -> dict[str, NDArray[np.float64]]:
    """Return 3 sigma with PID on random drives with different seeds [nm], by method."""
    due = [trial(runs, case, 1 + drive, drive=drive) for case in _COMPARED.values() for drive in range(drives)]
    found = on_trials(Trial.three_sigma, due, 'random drives').reshape(len(_COMPARED), drives)
    return dict(zip(_COMPARED, found, strict=True))


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per method."""
    rows, diverged = [], []
    for method, found in on_random_drives(runs, DRIVES).items():
        nominal = trial(runs, _COMPARED[method], 1).three_sigma()
        unstable = np.flatnonzero(~np.isfinite(found))
        bounded = f'{len(found) - len(unstable)} of {len(found)}'
        rows.append((method, nominal, *(quantile(found, share) for share in _SHARES.values()), bounded))
        diverged += [f'{method} on drive {drive}' for drive in unstable]
    title = (
        f'{DRIVES} drives with random gain, modes and friction within +-20 %, each with different seeds: 3 sigma of '
        f'the head position in vibration from {TRANSIENT:g} to {DURATION:g} s [nm]. The feedforward uses the model of '
        'the nominal drive; accelerometer gain error +12.5 %.'
    )
    if diverged:
        title += f' **DIVERGED: {", ".join(diverged)}.**'
    return write_table(path, title, ('feedforward', 'nominal drive', *_SHARES, 'do not diverge'), rows)
