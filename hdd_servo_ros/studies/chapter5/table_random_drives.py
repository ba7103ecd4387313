"""Table: 200 random drives with gain, modes and friction within +-20 %, simulated without bags."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import FREQUENCIES, NN, PID, PID_FOR_SINES, SHIPPED, TRANSIENT
from hdd_servo_ros.studies.chapter5.random_drives import BOUND, errors_on_random_drives
from hdd_servo_ros.studies.output import write_table

DRIVES = 200
_RUNS = {
    'law of the thesis': NN,
    'PID, at most 20 % overshoot': PID,
    'PID for sines': PID_FOR_SINES,
    'adaptive NN as shipped': SHIPPED,
}
CASES = tuple(case for cases in _RUNS.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs on ``DRIVES`` drives, and write one row per frequency and controller."""
    cases = {(frequency, name): cases[frequency] for frequency in FREQUENCIES for name, cases in _RUNS.items()}
    errors = errors_on_random_drives(runs, list(cases.values()), range(DRIVES))
    rows, unbounded = [], []
    for ((frequency, name), case), (rms, largest, ever) in zip(cases.items(), errors.transpose(0, 2, 1), strict=True):
        nominal = runs.metrics(case, TRANSIENT, NANOMETRES).rms_error
        # The largest error of a run that diverged is NaN, which is not below the bound.
        outside = np.flatnonzero(~(ever <= BOUND))
        bounded = f'{DRIVES - len(outside)} of {DRIVES}'
        rows.append(
            (f'{frequency:g}', name, nominal, float(np.median(rms)), float(rms.max()), float(largest.max()), bounded)
        )
        unbounded += [f'{name} at {frequency:g} Hz on drive {drive}' for drive in outside]
    header = (
        'frequency [Hz]',
        'controller',
        'rms error, nominal drive [nm]',
        'median rms error [nm]',
        'worst rms error [nm]',
        'largest error [nm]',
        'bounded',
    )
    title = (
        f'Sine of 2 um, 2 to 10 s. Nominal drive: from bags. {DRIVES} drives with random gain, modes and friction '
        f'within +-20 %: simulated without recording. Bounded: the error never exceeds {BOUND:g} nm, from 0 s on.'
    )
    if unbounded:
        title += f' **NOT BOUNDED: {", ".join(unbounded)}.**'
    return write_table(path, title, header, rows)
