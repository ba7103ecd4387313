"""Table: tracking errors with one sample of computation delay."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import (
    FREQUENCIES,
    PID,
    PID_DELAY,
    PID_FOR_SINES,
    PID_FOR_SINES_DELAY,
    SHIPPED,
    SHIPPED_DELAY,
    TRANSIENT,
)
from hdd_servo_ros.studies.output import write_table

_RUNS = {
    'adaptive NN as shipped': (SHIPPED, SHIPPED_DELAY),
    'PID, at most 20 % overshoot': (PID, PID_DELAY),
    'PID for sines': (PID_FOR_SINES, PID_FOR_SINES_DELAY),
}
CASES = tuple(case for pair in _RUNS.values() for cases in pair for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per controller and frequency."""
    rows = []
    for name, (prompt, delayed) in _RUNS.items():
        for frequency in FREQUENCIES:
            before, after = (runs.metrics(cases[frequency], TRANSIENT, NANOMETRES) for cases in (prompt, delayed))
            rows.append(
                (
                    name,
                    f'{frequency:g}',
                    before.rms_error,
                    after.rms_error,
                    after.max_error,
                    after.rms_error / before.rms_error,
                )
            )
    header = (
        'controller',
        'frequency [Hz]',
        'rms error without delay [nm]',
        'rms error with one sample [nm]',
        'max error with one sample [nm]',
        'ratio of the rms errors',
    )
    return write_table(
        path, 'Sine of 2 um, 2 to 10 s; the controllers with one sample of delay are tuned for it.', header, rows
    )
