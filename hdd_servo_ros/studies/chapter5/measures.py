"""Measures of recorded runs for the figures and tables of chapter 5."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import NANOMETRES, StepResponse, loop_area, rms, step_response
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.studies.chapter5.cases import HYSTERESIS_FREQUENCY, STEP_FREQUENCY

FIRST_MILLISECONDS = 5e-3
"""Duration of the transient after an edge [s]."""
START = 0.05
"""Duration of the transient on a sine: five periods at 100 Hz [s]."""


def error(run: RecordedRun) -> NDArray[np.float64]:
    """Return the error x - x_d of the true head position [nm], shape (n,)."""
    return run.error * NANOMETRES


def edges(run: RecordedRun) -> StepResponse:
    """
    Return the responses to all edges of a square wave but the first, or to a single step.

    The first edge of a square wave starts from rest and has half the height; the single steps cover this case.
    """
    found = step_response(run.time, run.desired_position, run.position)
    if len(found) == 1:
        return found
    return dataclasses.replace(
        found, **{field.name: getattr(found, field.name)[1:] for field in dataclasses.fields(found)}
    )


def error_after_edges(run: RecordedRun) -> float:
    """Return the rms error over the first 5 ms after each edge, without the edges before 1 s [nm]."""
    since_edge = np.mod(run.time + 1e-9, 0.5 / STEP_FREQUENCY)
    chosen = (since_edge < FIRST_MILLISECONDS) & (run.time >= 1.0)
    return rms(error(run)[chosen])


def last_cycles(run: RecordedRun, cycles: int) -> slice:
    """Return the rows of the last cycles at 80 Hz, without the end point of the last cycle."""
    rows = round(cycles / HYSTERESIS_FREQUENCY / run.sample_time)
    return slice(len(run.time) - rows, None)


@dataclasses.dataclass(frozen=True)
class LoopAreas:
    """Mean areas of the hysteresis loops over the true displacement in the last 2 s [V um]."""

    feedback: float
    """Area for the feedback part -k r of the command."""
    command: float
    """Area for the command."""
    friction: float
    """Area for the pivot friction."""


def loop_areas(run: RecordedRun) -> LoopAreas:
    """Return the loop areas of a run at 80 Hz."""
    cycles = round(2.0 * HYSTERESIS_FREQUENCY)
    rows = last_cycles(run, cycles)
    x = run.position[rows]
    forces = (run.feedback[rows], run.command[rows], run.head[rows, 2])
    return LoopAreas(*(loop_area(x, force, cycles) for force in forces))
