"""The recorded runs of a campaign: made where they are not there, whole and those of the table, already."""

import dataclasses
import shutil
from pathlib import Path

from hdd_servo_ros.campaign.folder import StudyError
from hdd_servo_ros.campaign.measuring import record_run
from hdd_servo_ros.campaign.planning import CampaignRun
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.signals_digest import signals_digest


@dataclasses.dataclass(frozen=True)
class KeptRun:
    """
    A run that is kept.

    Attributes
    ----------
    run
        What runs.
    status, digest
        As the table has them.
    """

    run: CampaignRun
    status: str
    digest: str


def run_name(run: CampaignRun) -> str:
    """Return the name of the folder of a recorded run."""
    return f'{run.number:06d}'


def keep_run(directory: Path, kept: KeptRun) -> None:
    """
    Record a run, unless it is there.

    Parameters
    ----------
    directory
        Folder of all recorded runs.
    kept
        The run.

    Raises
    ------
    StudyError
        If the recording has other signals than the run that was measured.
    """
    folder = directory / run_name(kept.run)
    if _is_there(folder, kept):
        return
    # Left by a process that was killed, or damaged since.
    if folder.exists():
        shutil.rmtree(folder)
    directory.mkdir(exist_ok=True)
    if record_run(folder, kept.run) != kept.digest:
        raise StudyError(f'run {kept.run.number}: its recording has other signals than the run that was measured')


def _is_there(folder: Path, kept: KeptRun) -> bool:
    """Return whether a folder holds the whole recording of a run: its status, and every bit of its signals."""
    try:
        recorded = RecordedRun.open(folder)
        return recorded.status == kept.status and signals_digest(recorded) == kept.digest
    except Exception:
        # Whatever is wrong with it, the run can be made again.
        return False
