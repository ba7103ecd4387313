"""Table: 3 sigma in the rotational vibration, five methods of feedforward, PID and adaptive NN controller."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import GAINS, IN_VIBRATION, TRANSIENT
from hdd_servo_ros.studies.mobile.trials import DURATION
from hdd_servo_ros.studies.mobile.vibration_table import write_vibration

SEEDS = 20
_BASE = {controller: cases['fxlms'] for controller, cases in IN_VIBRATION.items()}
CASES = tuple(_BASE.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Make the recorded runs again with other methods, sensors and seeds, and write one row per method and sensor."""
    title = (
        f"12.5 rad/s^2 rms from 10 to 500 Hz, no computation delay: 3 sigma of the head's position from {TRANSIENT:g} "
        f'to {DURATION:g} s, median / 95 % quantile over {SEEDS} seeds of vibration, vibrometer and accelerometers and '
        f'over gains of the accelerometers that are 12.5 % too small and too large. {GAINS}.'
    )
    return write_vibration(runs, path, title, _BASE, SEEDS)
