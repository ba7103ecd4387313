"""The close-up of a run next to its time plots."""

import numpy as np

from hdd_servo_ros.analysis.metrics import is_stepwise
from hdd_servo_ros.messages.topics import REFERENCE
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.long_runs import stretch_of
from hdd_servo_ros.reporting.panel import CloseUp
from hdd_servo_ros.reporting.reference_period import reference_period
from hdd_servo_ros.reporting.seeks_of_run import responses_of, seeks_of, tolerance_of

PERIODS = 3
_LAST_SAMPLES = 300
_BEFORE_EDGE, _AFTER_EDGE = 10, 100
"""Samples around an edge of the reference."""
_BEFORE_SEEK, _AFTER_SEEK = 0.5e-3, 1.5e-3
"""Time before a seek, and after its arrival [s]."""


def close_up_of(run: RecordedRun) -> CloseUp | None:
    """
    Return the close-up of a run.

    It shows the last seek that arrives (the last seek if none does); otherwise the last edge of a stepwise reference
    with a complete response, the last periods of a periodic one, or the last samples. None for a run that is not longer
    than the close-up. For a long run only its last stretch counts; see
    :func:`~hdd_servo_ros.reporting.long_runs.stretch_of`.
    """
    run = stretch_of(run)
    rows = len(run.ticks)
    start, end, title = rows - 1 - _LAST_SAMPLES, rows - 1, 'last samples'
    if REFERENCE.name in run:
        seek = _last_seek(run)
        if seek is not None:
            return seek
        edge = _last_edge(run)
        period = reference_period(run)
        if edge is not None:
            start, end, title = max(0, edge - _BEFORE_EDGE), min(rows - 1, edge + _AFTER_EDGE), 'last edge'
        elif period is not None and not is_stepwise(run.desired_position):
            start, title = rows - 1 - round(PERIODS * period), 'last periods'
    if start < 0 or (start == 0 and end == rows - 1):
        return None
    return CloseUp(float(run.time[start]), float(run.time[end]), title)


def _last_seek(run: RecordedRun) -> CloseUp | None:
    """Return the close-up of a seek; None in a run without seeks."""
    tolerance = tolerance_of(run)
    if tolerance is None or not seeks_of(run):
        return None
    responses = responses_of(run, tolerance)
    arrived = [response for response in responses if response.has_arrived]
    shown = (arrived or responses)[-1]
    start = float(run.time[shown.seek.row])
    lasts = min(shown.watched, shown.seek_time + _AFTER_SEEK) if arrived else shown.watched
    title = 'last seek that arrives' if arrived else 'last seek, which does not arrive'
    return CloseUp(max(float(run.time[0]), start - _BEFORE_SEEK), min(float(run.time[-1]), start + lasts), title)


def _last_edge(run: RecordedRun) -> int | None:
    """Return the row of the last edge of a stepwise reference; None without an edge."""
    if not is_stepwise(run.desired_position):
        return None
    edges = np.flatnonzero(np.diff(run.desired_position)) + 1
    complete = edges[edges + _AFTER_EDGE < len(run.ticks)]
    found = complete if len(complete) else edges
    return int(found[-1]) if len(found) else None
