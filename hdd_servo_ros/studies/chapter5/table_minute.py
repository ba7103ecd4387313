"""Table: the compensator over a minute."""

from pathlib import Path

from hdd_servo_ros.analysis.metrics import rms
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import NN_COMPENSATOR_MINUTE
from hdd_servo_ros.studies.chapter5.measures import error
from hdd_servo_ros.studies.output import write_table

CASES = tuple(NN_COMPENSATOR_MINUTE.values())
_SECONDS = (1, 2, 5, 10, 20, 40, 60)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row a frequency: the errors of single seconds."""
    rows = []
    for frequency, case in NN_COMPENSATOR_MINUTE.items():
        run = runs[case]
        e = error(run)
        by_second = [rms(e[(run.time >= end - 1.0) & (run.time < end)]) for end in _SECONDS]
        rows.append((f'{frequency:g}', *by_second))
    header = ('frequency [Hz]', *(f'second {second}' for second in _SECONDS))
    title = 'Adaptive NN with compensator, sine of 2 um: rms error of single seconds [nm].'
    return write_table(path, title, header, rows)
