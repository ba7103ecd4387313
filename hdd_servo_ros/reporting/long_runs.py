"""Runs that are not read into arrays for their summary and their picture."""

from hdd_servo_ros.recording.recorded_run import RecordedRun

VERY_LONG_RUN = 2**22
"""Ticks from which a run is not read into arrays for its summary and its picture."""


def is_very_long(run: RecordedRun) -> bool:
    """Return whether the arrays of a run would take gigabytes."""
    return run.is_long and run.last_tick >= VERY_LONG_RUN
