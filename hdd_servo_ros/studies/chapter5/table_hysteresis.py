"""Table: areas of the hysteresis loops at 80 Hz with terms of the law disabled, and with PID."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import HYSTERESIS, HYSTERESIS_OFF, HYSTERESIS_PID, TRANSIENT
from hdd_servo_ros.studies.chapter5.measures import loop_areas
from hdd_servo_ros.studies.output import write_table

_RUNS = {**HYSTERESIS, **HYSTERESIS_PID}
CASES = tuple(_RUNS.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per variant."""
    without = loop_areas(runs[HYSTERESIS_OFF]).feedback
    rows = []
    for name, case in _RUNS.items():
        areas = loop_areas(runs[case])
        reduction = f'{100.0 * (1.0 - areas.feedback / without):.1f} %'
        error = runs.metrics(case, TRANSIENT, NANOMETRES).rms_error
        rows.append((name, 1e3 * areas.feedback, reduction, 1e3 * areas.command, 1e3 * areas.friction, error))
    header = (
        'variant',
        'feedback part [mV um]',
        'reduced by',
        'command [mV um]',
        'friction [mV um]',
        'rms error [nm]',
    )
    return write_table(
        path, 'Areas of the loops over displacement, sine of 2 um at 80 Hz, last 2 of 10 s.', header, rows
    )
