"""What of a run counts, and for what: runs that follow a reference, and the part after the transient."""

from typing import TYPE_CHECKING

import numpy as np

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.graph.recorded_nodes import kind_by_name
from hdd_servo_ros.messages.topics import ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.recording.recorded_run import RecordedRun

if TYPE_CHECKING:
    from hdd_servo_ros.analysis.metrics import StepResponse

SEEK_MODE, SEEK_TARGET = 'seek_mode', 'seek_target'
"""Columns of `/estimates` of a controller that seeks: its mode (0 follow, 1 seek, 2 settle), and the target [um]."""
NOT_ADAPTED = ('t', 'r', 'e', SEEK_MODE, SEEK_TARGET, 'seek_distance', 'seek_time', 'seek_trajectory', 'seek_u')
"""Columns of `/estimates` that are no estimates: time, errors, and what a controller that seeks is about to do."""
REFERENCE_GENERATOR = 'reference_generator'
SIGNAL_ANALYZER = 'signal_analyzer'
LONGEST_TRANSIENT = 2.0
"""What counts as transient in a long run [s]; in a short one it is the first half."""


def transient_of(duration: float, last_change: float = 0.0) -> float:
    """
    Return the time before which errors of a run do not count [s].

    Parameters
    ----------
    duration
        Of the whole run [s].
    last_change
        Time of the last change of the reference [s], which starts anew then; 0 if there was none.
    """
    return max(min(0.5 * duration, LONGEST_TRANSIENT), last_change)


def follows_reference(run: RecordedRun) -> bool:
    """Return whether the run has an error: a head that is to follow a reference."""
    return REFERENCE.name in run and HEAD.name in run and catalog.follows_reference(run.controller)


def gives_seek_mode(run: RecordedRun) -> bool:
    """Return whether the controller of a run gives its mode, as one does that seeks."""
    return ESTIMATES.name in run and SEEK_MODE in run.estimate_names


def waveform_of(run: RecordedRun) -> str:
    """Return the waveform of a run's reference, empty if it is not known."""
    try:
        return str(run.parameter(REFERENCE_GENERATOR, 'waveform'))
    except LookupError:
        return ''


def may_have_seeks(run: RecordedRun) -> bool:
    """Return whether it is worth to search a run for seeks: without the waveform ``seek`` or a mode there are none."""
    return follows_reference(run) and (waveform_of(run) == 'seek' or gives_seek_mode(run))


def transient_end(run: RecordedRun, after: float | None = None) -> float:
    """
    Return the time from which a run counts as steady [s].

    Parameters
    ----------
    run
        The run.
    after
        Time before which nothing counts [s]; None for the first half of the run, 2 s at most, or for the last change
        of the reference where that is later.
    """
    if after is not None:
        return after
    # In a bag of another recorder there may be changes from before the run, by a wall clock.
    changes = [
        change.tick
        for change in run.parameter_changes
        if kind_by_name(run.description, change.node) == REFERENCE_GENERATOR and change.tick <= run.last_tick
    ]
    return transient_of(run.duration, changes[-1] * run.sample_time if changes else 0.0)


def steady_start(run: RecordedRun, after: float | None = None) -> int:
    """Return the row from which the run counts as steady; see :func:`transient_end`."""
    start: int = run.since(transient_end(run, after)).start
    return start


def edge_responses(run: RecordedRun, band: float = 0.02) -> 'StepResponse':
    """
    Return how the head responds to the edges of a stepwise reference, by the run's position error.

    Where the servo sensor's track is at the first tick is not an edge of the reference.

    Parameters
    ----------
    run
        The run.
    band
        Half width of the settling band, as a fraction of the edge's height.

    Raises
    ------
    ValueError
        If the reference is not stepwise, or has no edge.
    """
    from hdd_servo_ros.analysis.metrics import step_response

    position = np.array(run.relative_position)
    position[0] = run.position[0]
    return step_response(run.time, run.desired_position, position, band)


def changes_at_all(values: np.ndarray) -> bool:
    """Return whether an estimate was adapted: whether it is not the same in all rows."""
    return bool(np.any(values != values[0]))
