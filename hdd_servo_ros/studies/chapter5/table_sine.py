"""Table: tracking errors of all controllers on the 2 µm sines."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import (
    FREQUENCIES,
    NN,
    PID,
    PID_FOR_SINES,
    PID_SAME_GAINS,
    SHIPPED,
    TRANSIENT,
)
from hdd_servo_ros.studies.output import write_table

_RUNS = {
    'law of the thesis': NN,
    'PID, at most 20 % overshoot': PID,
    'PID for sines, no limit of overshoot': PID_FOR_SINES,
    'PD with the gains of the law of the thesis': PID_SAME_GAINS,
    'adaptive NN as shipped': SHIPPED,
}
CASES = tuple(case for cases in _RUNS.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per frequency and controller."""
    rows = []
    for frequency in FREQUENCIES:
        for name, cases in _RUNS.items():
            found = runs.metrics(cases[frequency], TRANSIENT, NANOMETRES)
            own = runs.metrics(SHIPPED[frequency], TRANSIENT, NANOMETRES).rms_error
            rows.append(
                (
                    f'{frequency:g}',
                    name,
                    found.rms_error,
                    found.max_error,
                    found.tmr,
                    found.peak_control,
                    own / found.rms_error,
                )
            )
    header = (
        'frequency [Hz]',
        'controller',
        'rms error [nm]',
        'max error [nm]',
        'TMR [nm]',
        'peak control [V]',
        'rms error, shipped / this controller',
    )
    return write_table(path, 'Sine of 2 um, 2 to 10 s; peak control from 0 s.', header, rows)
