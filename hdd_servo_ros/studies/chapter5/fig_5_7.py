"""Fig. 5.7: tracking error on the 2 µm sine at 100 Hz."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter5.sine_figures import compared, draw_error

_FREQUENCY = 100.0
CASES = tuple(compared(_FREQUENCY).values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw both PID controllers, the law of the thesis, and the adaptive NN controller as shipped."""
    return draw_error(runs, path, '5.7', _FREQUENCY)
