"""Table: steps of 0.5 and 5 µm, single from rest and in a square wave."""

import itertools
from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import (
    HEIGHTS,
    LAW_FROM_REST,
    LAW_STEPS,
    PID_FOR_SINES_FROM_REST,
    PID_FOR_SINES_STEPS,
    PID_FROM_REST,
    PID_STEPS,
    SHIPPED_FROM_REST,
    SHIPPED_STEPS,
    STEP_TIME,
)
from hdd_servo_ros.studies.chapter5.measures import edges
from hdd_servo_ros.studies.output import write_table

_NAMES = ('law of the thesis', 'adaptive NN as shipped', 'PID, at most 20 % overshoot', 'PID for sines')
_RUNS = {
    'single, from rest': dict(
        zip(_NAMES, (LAW_FROM_REST, SHIPPED_FROM_REST, PID_FROM_REST, PID_FOR_SINES_FROM_REST), strict=True)
    ),
    'square wave': dict(zip(_NAMES, (LAW_STEPS, SHIPPED_STEPS, PID_STEPS, PID_FOR_SINES_STEPS), strict=True)),
}
CASES = tuple(case for kind in _RUNS.values() for cases in kind.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per height, kind of step and controller."""
    rows = []
    for height, (kind, by_controller) in itertools.product(HEIGHTS, _RUNS.items()):
        for name, cases in by_controller.items():
            found = edges(runs[cases[height]])
            worst, median = found.worst(), found.median()
            rows.append(
                (
                    f'{height:g}',
                    kind,
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
        'reference',
        'controller',
        'overshoot [%]',
        '2 % settling [ms]',
        'median settling [ms]',
        'mean steady error [nm]',
        'peak control [V]',
    )
    title = (
        f'10 s each. Single: 0 to the height at {STEP_TIME:g} s. Square wave: -height/2 to height/2 and back at 10 Hz; '
        'the worst of all edges but the first, or the median of all edges but the first where stated.'
    )
    return write_table(path, title, header, rows)


def _milliseconds(seconds: float) -> float | str:
    return 1e3 * seconds if seconds < 1.0 else 'does not settle'
