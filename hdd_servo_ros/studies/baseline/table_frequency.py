"""Table: errors of the adaptive NN controller and both PID controllers over frequency."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import AMPLITUDE, DURATION, OVER_FREQUENCY, TRANSIENT
from hdd_servo_ros.studies.baseline.error_table import write_errors

CASES = tuple(case for cases in OVER_FREQUENCY.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per frequency: rms and maximum error of each controller."""
    title = f'Sine of {AMPLITUDE:g} um, {TRANSIENT:g} to {DURATION:g} s: rms / max error [nm].'
    return write_errors(runs, path, title, 'frequency [Hz]', OVER_FREQUENCY)
