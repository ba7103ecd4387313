"""Fig. 5.17: estimates on 0.5 µm steps."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.cases import SHIPPED_STEPS
from hdd_servo_ros.studies.chapter5.drawing import draw_estimates

_CASE = SHIPPED_STEPS[0.5]
CASES = (_CASE,)


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the four estimates of the adaptive NN controller as shipped."""
    return draw_estimates(runs, path, 'Fig. 5.17: estimates, steps of 0.5 µm', _CASE)
