"""The evaluation window of a run: whether it follows a reference, and the end of its transient."""

from typing import TYPE_CHECKING

import numpy as np

from hdd_servo_ros.graph import catalog
from hdd_servo_ros.graph.recorded_nodes import kind_by_name
from hdd_servo_ros.messages.topics import ESTIMATES, HEAD, REFERENCE
from hdd_servo_ros.recording.recorded_run import RecordedRun

if TYPE_CHECKING:
    from hdd_servo_ros.analysis.metrics import StepResponse

SEEK_MODE, SEEK_TARGET = 'seek_mode', 'seek_target'
"""Columns of `/estimates` of the seek controller: mode (0 follow, 1 seek, 2 settle), and target [um]."""
NOT_ADAPTED = ('t', 'r', 'e', SEEK_MODE, SEEK_TARGET, 'seek_distance', 'seek_time', 'seek_trajectory', 'seek_u')
"""Columns of `/estimates` that are not estimates: time, errors, and the state of the seek controller."""
REFERENCE_GENERATOR = 'reference_generator'
SIGNAL_ANALYZER = 'signal_analyzer'
LONGEST_TRANSIENT = 2.0
"""Transient of a long run [s]; in a short run it is the first half."""


def transient_of(duration: float, last_change: float = 0.0) -> float:
    """
    Return the end of the transient [s], from which errors count.

    Parameters
    ----------
    duration
        Duration of the run [s].
    last_change
        Time of the last change of the reference [s], which restarts the transient; 0 without a change.
    """
    return max(min(0.5 * duration, LONGEST_TRANSIENT), last_change)


def follows_reference(run: RecordedRun) -> bool:
    """Return whether the run has a tracking error, because the head follows a reference."""
    return REFERENCE.name in run and HEAD.name in run and catalog.follows_reference(run.controller)


def gives_seek_mode(run: RecordedRun) -> bool:
    """Return whether the controller publishes its seek mode."""
    return ESTIMATES.name in run and SEEK_MODE in run.estimate_names


def waveform_of(run: RecordedRun) -> str:
    """Return the waveform of the reference; empty if it is unknown."""
    try:
        return str(run.parameter(REFERENCE_GENERATOR, 'waveform'))
    except LookupError:
        return ''


def may_have_seeks(run: RecordedRun) -> bool:
    """Return whether a run can have seeks, which need the waveform ``seek`` or a seek mode."""
    return follows_reference(run) and (waveform_of(run) == 'seek' or gives_seek_mode(run))


def transient_end(run: RecordedRun, after: float | None = None) -> float:
    """
    Return the end of the transient of a run [s].

    Parameters
    ----------
    run
        The run.
    after
        Start of the window [s]; None for the first half of the run, at most 2 s, or for the last change of the
        reference if that is later.
    """
    if after is not None:
        return after
    # A bag of another recorder may have earlier changes, stamped by a wall clock.
    changes = [
        change.tick
        for change in run.parameter_changes
        if kind_by_name(run.description, change.node) == REFERENCE_GENERATOR and change.tick <= run.last_tick
    ]
    return transient_of(run.duration, changes[-1] * run.sample_time if changes else 0.0)


def steady_start(run: RecordedRun, after: float | None = None) -> int:
    """Return the first row after the transient; see :func:`transient_end`."""
    start: int = run.since(transient_end(run, after)).start
    return start


def edge_responses(run: RecordedRun, band: float = 0.02) -> 'StepResponse':
    """
    Return the responses of the head to the edges of a stepwise reference, from the position error.

    The position of the track at the first tick of the servo sensor is not an edge.

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
    """Return whether an estimate was adapted, i.e. whether its rows differ."""
    return bool(np.any(values != values[0]))
