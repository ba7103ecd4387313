"""Fig. 5.20: tracking error on the 2 µm sine at 100 Hz for different lambda."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import LAMBDA_SINES
from hdd_servo_ros.studies.chapter5.drawing import draw_start_and_end
from hdd_servo_ros.studies.chapter5.measures import error

CASES = tuple(LAMBDA_SINES.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the error in the transient and after adaptation."""
    title = 'Fig. 5.20: tracking error, sine of 2 µm at 100 Hz, fixed k'
    cases = {rf'$\lambda$ = {value:g} 1/s': case for value, case in LAMBDA_SINES.items()}
    return draw_start_and_end(runs, path, title, 'error [nm]', cases, error, 0.01, start=0.05)
