"""Fig. 5.11: estimates on the 2 µm sine at 100 Hz."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import NN
from hdd_servo_ros.studies.chapter5.drawing import draw_estimates

_CASE = NN[100.0]
CASES = (_CASE,)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the four estimates of the adaptive NN controller."""
    return draw_estimates(runs, path, 'Fig. 5.11: estimates, sine of 2 µm at 100 Hz', _CASE)
