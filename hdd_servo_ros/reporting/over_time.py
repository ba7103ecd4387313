"""The signals for the time plots of a run."""

from hdd_servo_ros.messages.signals import TimedSignals
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.long_figures import long_figures
from hdd_servo_ros.reporting.long_runs import rows_of
from hdd_servo_ros.reporting.panel import CloseUp


def signals_over_time(run: RecordedRun, after: float | None = None, close_up: CloseUp | None = None) -> TimedSignals:
    """
    Return the signals of a run for time plots, decimated for a long run.

    Parameters
    ----------
    run
        The run.
    after
        Start of the window of the results [s]; see :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
    close_up
        The close-up, which is not decimated.
    """
    if not run.is_long:
        return run
    rows = long_figures(run, after).rows_over_time
    if close_up is None:
        return rows
    # The line of a close-up extends to the next row.
    part = slice(run.since(close_up.start).start, run.since(close_up.end).start + 2)
    return rows.with_stretches(rows_of(run, part)) if part.start < run.row_count else rows
