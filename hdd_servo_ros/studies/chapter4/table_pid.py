"""Table: adaptive NN controller and PID at the same peak control."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import (
    COMPARED_LAMBDAS,
    FEEDFORWARD_BY_LAMBDA,
    LAST_HALF,
    NN_BY_LAMBDA,
    PID_BY_LAMBDA,
)
from hdd_servo_ros.studies.output import write_table

_CONTROLLERS = {
    'adaptive NN': NN_BY_LAMBDA,
    'best PID': PID_BY_LAMBDA,
    'best PID with acceleration feedforward': FEEDFORWARD_BY_LAMBDA,
}
CASES = tuple(cases[value] for cases in _CONTROLLERS.values() for value in COMPARED_LAMBDAS)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per lambda and controller."""
    rows = []
    for value in COMPARED_LAMBDAS:
        own = runs.metrics(NN_BY_LAMBDA[value], LAST_HALF).rms_error
        for label, cases in _CONTROLLERS.items():
            found = runs.metrics(cases[value], LAST_HALF)
            errors = (1e3 * found.rms_error, 1e3 * found.max_error, found.rms_error / own)
            rows.append((f'{value:g}', label, *errors, found.peak_control))
    header = (
        'lambda [1/s]',
        'controller',
        'rms error [mm]',
        'max error [mm]',
        'rms error / adaptive NN',
        'peak control [N]',
    )
    return write_table(path, 'Last half of 20 s.', header, rows)
