"""Table: 3 sigma in rotational vibration with five feedforward methods, PID and adaptive NN controller."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import GAINS, IN_VIBRATION, TRANSIENT
from hdd_servo_ros.studies.mobile.trials import DURATION
from hdd_servo_ros.studies.mobile.vibration_table import write_vibration

SEEDS = 20
_BASE = {controller: cases['fxlms'] for controller, cases in IN_VIBRATION.items()}
CASES = tuple(_BASE.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with other methods, sensors and seeds, and write one row per method and sensor."""
    title = (
        f'12.5 rad/s^2 rms from 10 to 500 Hz, no computation delay: 3 sigma of the head position from {TRANSIENT:g} '
        f'to {DURATION:g} s, median / 95th percentile over {SEEDS} seeds of vibration, vibrometer and accelerometers '
        f'and accelerometer gain errors of -12.5 % and +12.5 %. {GAINS}.'
    )
    return write_vibration(runs, path, title, _BASE, SEEDS)
