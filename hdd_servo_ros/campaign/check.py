"""Comparison of a recorded run with the table of a campaign."""

import csv
from pathlib import Path

from hdd_servo_ros.messages.exit_codes import UnreadableError, reading
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.signals_digest import signals_digest


def same_runs(folder: Path, run_dir: Path) -> list[int]:
    """
    Return the numbers of the runs of a campaign whose signals are bit-identical to a recorded run.

    Parameters
    ----------
    folder
        Directory of the campaign.
    run_dir
        Directory of the recorded run.

    Raises
    ------
    UnreadableError
        If the directory has no table, or the run cannot be read.
    """
    path = folder / 'table.csv'
    try:
        with path.open(encoding='utf8', newline='') as file:
            digests = {int(row['run']): row['digest'] for row in csv.DictReader(file)}
    except OSError as error:
        raise UnreadableError(f'{path}: {error.strerror or error}; only a finished campaign has a table') from None
    except (KeyError, TypeError, ValueError) as error:
        raise UnreadableError(f'{path} is not the table of a campaign') from error
    with reading(run_dir):
        digest = signals_digest(RecordedRun.open(run_dir))
    return [number for number, found in digests.items() if found == digest]
