"""The recorded runs of a campaign: made unless an intact recording with the same signals exists."""

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
    A run to keep.

    Attributes
    ----------
    run
        The run.
    status, digest
        Values in the table.
    """

    run: CampaignRun
    status: str
    digest: str


def run_name(run: CampaignRun) -> str:
    """Return the directory name of a recorded run."""
    return f'{run.number:06d}'


def keep_run(directory: Path, kept: KeptRun) -> None:
    """
    Record a run, unless an intact recording exists.

    Parameters
    ----------
    directory
        Parent directory of the recorded runs.
    kept
        The run.

    Raises
    ------
    StudyError
        If the recording is not bit-identical to the run that was measured.
    """
    folder = directory / run_name(kept.run)
    if _is_there(folder, kept):
        return
    # The process that recorded it was killed, or the files were damaged later.
    if folder.exists():
        shutil.rmtree(folder)
    directory.mkdir(exist_ok=True)
    if record_run(folder, kept.run) != kept.digest:
        raise StudyError(f'run {kept.run.number}: its recording is not bit-identical to the run that was measured')


def _is_there(folder: Path, kept: KeptRun) -> bool:
    """Return whether a directory holds the complete recording of a run, with its status and bit-identical signals."""
    try:
        recorded = RecordedRun.open(folder)
        return recorded.status == kept.status and signals_digest(recorded) == kept.digest
    except Exception:
        # Whatever the damage, the run can be recorded again.
        return False
