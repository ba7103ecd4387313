"""Table: tracking error and peak control over lambda, at two sample times."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, NN_BY_LAMBDA, at_sample_time
from hdd_servo_ros.studies.output import write_table

COARSE = 1e-3
"""Second sample time [s]; the parameter file has 1e-4."""
NN_COARSE = {value: at_sample_time(case, COARSE) for value, case in NN_BY_LAMBDA.items()}
CASES = (*NN_BY_LAMBDA.values(), *NN_COARSE.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per lambda."""
    rows = []
    for value, case in NN_BY_LAMBDA.items():
        found, coarse = (runs.metrics(either, LAST_HALF) for either in (case, NN_COARSE[value]))
        rows.append(
            (f'{value:g}', 1e3 * found.rms_error, 1e3 * found.max_error, found.peak_control, 1e3 * coarse.rms_error)
        )
    sample_time = runs[CASES[0]].sample_time
    header = ('lambda [1/s]', 'rms error [mm]', 'max error [mm]', 'peak control [N]', 'rms error at T = 1e-3 s [mm]')
    return write_table(path, f'Last half of 20 s, T = {sample_time:g} s.', header, rows)
