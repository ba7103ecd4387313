"""Table: 3 sigma in rotational vibration with one sample of computation delay."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import DELAYED, TRANSIENT
from hdd_servo_ros.studies.mobile.trials import DURATION
from hdd_servo_ros.studies.mobile.vibration_table import write_vibration

SEEDS = 5
CASES = tuple(DELAYED.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs with other methods, sensors and seeds, and write one row per method and sensor."""
    title = (
        f'12.5 rad/s^2 rms from 10 to 500 Hz, one sample of computation delay and the gains of one_sample_delay.yaml: '
        f'3 sigma of the head position from {TRANSIENT:g} to {DURATION:g} s, median / 95th percentile over {SEEDS} '
        'seeds and accelerometer gain errors of -12.5 % and +12.5 %. PID: k_p 0.146, k_i 8.68, '
        'k_d 8.67e-5, no filter.'
    )
    return write_vibration(runs, path, title, DELAYED, SEEDS, with_limits=False)
