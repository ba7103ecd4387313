"""Table: steps of 0.5 and 5 um."""

from pathlib import Path

from hdd_servo_ros.loop.metrics import NANOMETRES
from hdd_servo_ros.studies.chapter5.cases import HEIGHTS, LAW_STEPS, NN_STEPS, PID_STEPS
from hdd_servo_ros.studies.chapter5.measures import edges
from hdd_servo_ros.studies.output import write_table
from hdd_servo_ros.studies.recorded import RecordedRuns

_RUNS = {
    'law of the thesis': LAW_STEPS,
    'adaptive NN with integral action': NN_STEPS,
    'PID': PID_STEPS,
}
CASES = tuple(case for cases in _RUNS.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row a height and controller."""
    rows = []
    for height in HEIGHTS:
        for name, cases in _RUNS.items():
            found = edges(runs[cases[height]])
            worst, median = found.worst(), found.median()
            rows.append(
                (
                    f'{height:g}',
                    name,
                    worst['overshoot'],
                    _milliseconds(worst['settling_time']),
                    _milliseconds(median['settling_time']),
                    NANOMETRES * worst['steady_error'],
                    runs.metrics(cases[height], 0.0).peak_control,
                )
            )
    header = (
        'step [um]',
        'controller',
        'overshoot [%]',
        '2 % settling [ms]',
        'its median [ms]',
        'mean steady error [nm]',
        'peak control [V]',
    )
    title = 'Square wave of 10 Hz, 10 s: the worst of all edges but the first, unless it says median.'
    return write_table(path, title, header, rows)


def _milliseconds(seconds: float) -> float | str:
    return 1e3 * seconds if seconds < 1.0 else 'does not settle'
