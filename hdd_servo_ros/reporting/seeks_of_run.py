"""The seeks of a recorded run, the responses of the head, and the bounds of the seek times."""

import dataclasses
import math
import weakref

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import is_stepwise
from hdd_servo_ros.analysis.off_track import WRITE_LIMIT
from hdd_servo_ros.analysis.seek_metrics import SAMPLES, SEEK, Seek, SeekResponse, find_seeks, seek_responses
from hdd_servo_ros.graph.block_parameters import block_parameters
from hdd_servo_ros.messages.topics import CONTROL
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.reporting.evaluation import (
    REFERENCE_GENERATOR,
    SEEK_MODE,
    gives_seek_mode,
    may_have_seeks,
    waveform_of,
)
from hdd_servo_ros.reporting.long_runs import begins_within, stretch_of
from hdd_servo_ros.reporting.run_sensitivity import PLANT, SENSOR, parameters_at_start
from hdd_servo_ros.reporting.track_of_run import track_pitch

Array = NDArray[np.float64]

_CURVE_POINTS = 12
"""Largest number of lengths for which bounds are computed."""
_LONGEST_PROGRAM = 5e-3
"""Largest time-optimal seek time for which the linear program is solved [s]; above, modes hardly matter."""


@dataclasses.dataclass(frozen=True)
class BoundCurve:
    """
    Bounds of the seek time over length.

    Attributes
    ----------
    lengths
        Lengths in ascending order [um], shape (n,).
    time_optimal
        Time T* of the rigid body [s], shape (n,); see :func:`~hdd_servo_ros.analysis.seek_bounds.time_optimal_seek`.
    fastest
        Time of the sampled drive with its modes [s], shape (n,), nan for long seeks; see
        :func:`~hdd_servo_ros.analysis.seek_bounds.fastest_seek`.
    """

    lengths: Array
    time_optimal: Array
    fastest: Array

    def fastest_at(self, length: float) -> float:
        """Return the fastest time for a length [s], by logarithmic interpolation of the curve."""
        return float(np.exp(np.interp(math.log(length), np.log(self.lengths), np.log(self.fastest))))


class _Found:
    """Cached results of a run."""

    def __init__(self) -> None:
        self.seeks: tuple[Seek, ...] | None = None
        self.responses: dict[tuple[float, float | None, int, bool], list[SeekResponse]] = {}
        self.curves: dict[float, BoundCurve | None] = {}


_FOUND: weakref.WeakKeyDictionary[RecordedRun, _Found] = weakref.WeakKeyDictionary()


def modes_of(run: RecordedRun) -> Array | None:
    """Return the mode of the controller at each row (0 follow, 1 seek, 2 settle); None without modes."""
    return run.estimates[SEEK_MODE] if gives_seek_mode(run) else None


def seeks_of(run: RecordedRun) -> tuple[Seek, ...]:
    """
    Return the seeks of a run.

    A run has seeks if its reference has the waveform ``seek``, or if its reference is stepwise and its controller has
    the estimate ``seek_mode``. A reference that differs from the head position at the first row starts with a seek.
    """
    found = _FOUND.setdefault(run, _Found())
    if found.seeks is None:
        found.seeks = tuple(_search(run))
    return found.seeks


def part_with_seeks(run: RecordedRun) -> RecordedRun:
    """
    Return the part of a run that is searched for seeks: the whole run, or the last stretch of a long run.

    See :func:`~hdd_servo_ros.reporting.long_runs.stretch_of`. A long run that cannot have seeks is not read.
    """
    return stretch_of(run) if may_have_seeks(run) else run


def _search(run: RecordedRun) -> list[Seek]:
    if not may_have_seeks(run):
        return []
    along_trajectory = False
    if waveform_of(run) == 'seek':
        along_trajectory = run.parameter(REFERENCE_GENERATOR, 'seek.trajectory') != 'step'
    elif not is_stepwise(run.desired_position):
        return []
    seeks = find_seeks(run.desired_position, run.reference.velocity, along_trajectory)
    if begins_within(run):
        # A seek in progress at the first row started earlier.
        return seeks[1:] if seeks and run.reference.velocity[0] != 0.0 else seeks
    first, head = float(run.desired_position[0]), float(run.position[0])
    pitch = track_pitch(run)
    if pitch is not None and abs(first - head) > WRITE_LIMIT * pitch and not (seeks and seeks[0].row == 0):
        seeks.insert(0, Seek(0, head, first))
    return seeks


def tolerance_of(run: RecordedRun, of_pitch: float = WRITE_LIMIT) -> float | None:
    """Return a fraction of the track pitch [um]; None for a drive in other units."""
    pitch = track_pitch(run)
    return None if pitch is None else of_pitch * pitch


def measured_position(run: RecordedRun) -> Array:
    """
    Return the measured head position [um], shape (n,).

    Raises
    ------
    ValueError
        If the scale of the vibrometer is unknown.
    """
    if run.is_track_following:
        return run.pes.position
    try:
        scale = float(run.parameter(SENSOR, 'displacement_scale'))
    except LookupError as error:
        raise ValueError(f'{run.path}: no measured position: {error}') from None
    return np.asarray(scale * run.ldv.displacement)


def responses_of(
    run: RecordedRun,
    tolerance: float,
    stay: float | None = None,
    samples: int = SAMPLES,
    *,
    measured: bool = False,
) -> list[SeekResponse]:
    """
    Return the responses to the seeks of a run; see :func:`~hdd_servo_ros.analysis.seek_metrics.seek_responses`.

    The error is the distance of the true or the measured head position from the target. Seeks whose target changes
    before the end of their trajectory are omitted if the controller publishes its mode; so is the last of several seeks
    if the run ends within half of the time between seeks.
    """
    found, key = _FOUND.setdefault(run, _Found()), (tolerance, stay, samples, measured)
    if key not in found.responses:
        position = measured_position(run) if measured else run.relative_position
        control = run.command if CONTROL.name in run else np.zeros(len(position))
        seeks = seeks_of(run)
        responses = seek_responses(
            seeks,
            position,
            run.head.velocity,
            control,
            run.sample_time,
            tolerance,
            modes=modes_of(run),
            samples=samples,
            stay=stay,
        )
        # A run of an integer number of dwell times ends with the start of a seek.
        if len(seeks) > 1 and len(position) - seeks[-1].row < 0.5 * (seeks[-1].row - seeks[-2].row):
            responses.pop()
        modes = modes_of(run)
        if modes is not None:
            # A target that changes during a seek does not make the seek a failure.
            starts = [seek.row for seek in seeks[1:]]
            replaced = {seek.row for seek, start in zip(seeks, starts, strict=False) if modes[start - 1] == SEEK}
            responses = [response for response in responses if response.seek.row not in replaced]
        if begins_within(run):
            responses = [
                dataclasses.replace(response, time=float(run.time[response.seek.row])) for response in responses
            ]
        found.responses[key] = responses
    return found.responses[key]


def time_optimal_times(run: RecordedRun, seeks: list[Seek]) -> Array | None:
    """Return T* of each seek [s], shape (n,); None if the drive is unknown or has no rigid body."""
    # Imported late: it needs the compiled blocks.
    from hdd_servo_ros.analysis.seek_bounds import time_optimal_seek

    nodes = parameters_at_start(run)
    if PLANT not in nodes:
        return None
    plant = block_parameters(PLANT, nodes[PLANT])
    if not plant.resonance.has_rigid_body:
        return None
    return np.array([time_optimal_seek(plant, seek.length).time for seek in seeks])


def bound_curve(run: RecordedRun, tolerance: float) -> BoundCurve | None:
    """Return the bounds for the lengths of the seeks; None without seeks or a known drive with a rigid body."""
    found = _FOUND.setdefault(run, _Found())
    if tolerance not in found.curves:
        found.curves[tolerance] = _curve(run, tolerance)
    return found.curves[tolerance]


def _curve(run: RecordedRun, tolerance: float) -> BoundCurve | None:
    from hdd_servo_ros.analysis.seek_bounds import fastest_seek, time_optimal_seek

    nodes, seeks = parameters_at_start(run), seeks_of(run)
    if PLANT not in nodes or not seeks:
        return None
    plant = block_parameters(PLANT, nodes[PLANT])
    if not plant.resonance.has_rigid_body:
        return None
    lengths = np.unique(np.round([abs(seek.length) for seek in seeks], 6))
    if len(lengths) > _CURVE_POINTS:
        lengths = np.geomspace(lengths[0], lengths[-1], _CURVE_POINTS)
    optimal = np.array([time_optimal_seek(plant, length).time for length in lengths.tolist()])
    fastest = [
        fastest_seek(plant, run.sample_time, length, tolerance).time if time <= _LONGEST_PROGRAM else math.nan
        for length, time in zip(lengths.tolist(), optimal.tolist(), strict=True)
    ]
    # A seek within the tolerance takes no time, which has no logarithm.
    times = np.array(fastest)
    return BoundCurve(lengths, optimal, np.where(times > 0.0, times, math.nan))
