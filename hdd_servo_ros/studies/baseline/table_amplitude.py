"""Table: errors of the adaptive NN controller and both PID controllers over amplitude."""

from pathlib import Path

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.baseline.cases import DURATION, FREQUENCY, OVER_AMPLITUDE, TRANSIENT
from hdd_servo_ros.studies.baseline.error_table import write_errors

CASES = tuple(case for cases in OVER_AMPLITUDE.values() for case in cases.values())


def make(runs: RecordedRuns, path: Path) -> Path:
    """Write one row per amplitude: rms and maximum error of each controller."""
    title = f'Sine of {FREQUENCY:g} Hz, {TRANSIENT:g} to {DURATION:g} s: rms / max error [nm].'
    return write_errors(runs, path, title, 'amplitude [um]', OVER_AMPLITUDE)
