"""Fig. 5.15: response to 5 µm steps."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.step_figures import compared, draw_response

_HEIGHT = 5.0
CASES = tuple(compared(_HEIGHT).values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw both PID controllers, the law of the thesis, and the adaptive NN controller as shipped."""
    return draw_response(runs, path, '5.15', _HEIGHT)
