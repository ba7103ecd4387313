"""What a report says of a stretch of a long run alone."""

from hdd_servo_ros.messages.topics import BASE_ACCELERATION
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import follows_reference, steady_start
from hdd_servo_ros.reporting.long_runs import stretch_in_words, stretch_of
from hdd_servo_ros.reporting.run_bound import why_no_bound
from hdd_servo_ros.reporting.seeks_of_run import part_with_seeks, seeks_of
from hdd_servo_ros.reporting.track_metrics import has_track


def from_stretch(run: RecordedRun, after: float | None = None) -> list[str]:
    """
    Return what is from a stretch of a run alone, and from which, in a line; none if everything is from the whole run.

    ``after`` is that of :func:`~hdd_servo_ros.reporting.evaluation.transient_end`.
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
            found.append('the least error of feedback')
    return [f'from {stretch_in_words(run)} alone: {", ".join(found)}'] if found else []
