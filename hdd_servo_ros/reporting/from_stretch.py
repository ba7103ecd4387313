"""The results of a long run that are based on its last stretch only."""

from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_runs import stretch_in_words, stretch_of
from hdd_servo_ros.reporting.run_bound import why_no_bound
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks, seeks_of
from hdd_servo_ros.reporting.track_metrics import has_track


def from_stretch(run: RecordedRun, after: float | None = None) -> list[str]:
    """
    Return a line with the results that are based on a stretch of the run, and the stretch; empty without such results.

    For ``after`` see :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
    """
    if not run.is_long:
        return []
    found = []
    if follows_reference(run) and seeks_of(part_with_seeks(run)):
        found.append('seeks')
    if has_track(run):
        part = stretch_of(run)
        if BASE_ACCELERATION.name in run:
            found.append('responses to shocks')
        if not why_no_bound(part, steady_start(part, after)):
            found.append('the lower bound of the error')
    return [f'from {stretch_in_words(run)} only: {", ".join(found)}'] if found else []
