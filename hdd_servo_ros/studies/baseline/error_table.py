"""Table of the errors of several controllers over a quantity."""

from collections.abc import Mapping
from pathlib import Path

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import TRANSIENT
from hdd_servo_ros.studies.output import write_table


def write_errors(
    runs: RecordedRuns, path: Path, title: str, quantity: str, compared: Mapping[str, Mapping[float, Case]]
) -> Path:
    """
    Write rms and maximum error of each controller, one row per value, and return the file.

    Parameters
    ----------
    runs, path
        See :meth:`~hdd_servo_ros.studies.chapter.Figure.make`.
    title, quantity
        Title of the table, and head of its first column.
    compared
        Cases by name of the controller and value of the quantity.
    """
    values = list(next(iter(compared.values())))
    rows = [(f'{value:g}', *(_errors(runs, cases[value]) for cases in compared.values())) for value in values]
    return write_table(path, title, (quantity, *compared), rows)


def _errors(runs: RecordedRuns, case: Case) -> str:
    found = runs.metrics(case, TRANSIENT, NANOMETRES)
    return f'{found.rms_error:.3g} / {found.max_error:.3g}'
