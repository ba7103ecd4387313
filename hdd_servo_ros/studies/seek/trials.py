"""Repetitions of recorded runs with other seeks, drives, seeds or parameters, without bags; measures of the seeks."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.seek_metrics import find_seeks, seek_responses
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.mobile.trials import on_trials, trial
from hdd_servo_ros.studies.seek.cases import DWELL, NARROW, NEAR, TOLERANCE, drive_changes

MEASURES = ('length', 'time', 'narrow_time', 'first_arrival', 'settling', 'overshoot')
"""
Measures of a seek: signed length [um], time into +-100 nm and into +-25 nm [ms], time to the first four samples within
+-100 nm [ms], time from the first sample within +-2 µm to the arrival within +-100 nm [ms], overshoot [um].
"""
Measures = NDArray[Any]
_DTYPE = np.dtype([(name, np.float64) for name in MEASURES])
_SEEK = 'reference_generator:seek.'


@dataclasses.dataclass(frozen=True)
class SeekTrial:
    """
    Run with seeks, without recording.

    Attributes
    ----------
    controller
        Short name of the controller.
    sample_time
        T [s].
    parameters
        Parameters of all nodes, by node and name.
    ticks
        Duration of the run in ticks.
    sensor
        ``'ldv'`` or ``'servo'``.
    """

    controller: str
    sample_time: float
    parameters: Mapping[str, Mapping[str, Any]]
    ticks: int
    sensor: str = 'ldv'

    def measures(self) -> Measures:
        """Return :data:`MEASURES` as a structured array, shape (seeks,); times are infinite without arrival."""
        rows = Experiment(self.sample_time, self.controller, self.parameters, sensor=self.sensor).run(0, self.ticks)
        reference = rows.reference
        along = self.parameters['reference_generator']['seek.trajectory'] != 'step'
        seeks = find_seeks(reference[:, 0], reference[:, 1], along)
        head, velocity, control = rows.track_error + reference[:, 0], rows.head[:, 1], rows.control[:, 0]
        wide, narrow, near = (
            seek_responses(seeks, head, velocity, control, self.sample_time, tolerance)
            for tolerance in (TOLERANCE, NARROW, NEAR)
        )
        found = np.zeros(len(seeks), _DTYPE)
        for row, (response, tight, loose) in zip(found, zip(wide, narrow, near, strict=True), strict=True):
            row['length'] = response.seek.length
            row['time'], row['narrow_time'] = 1e3 * response.seek_time, 1e3 * tight.seek_time
            row['first_arrival'] = 1e3 * response.first_arrival
            row['settling'] = math.inf
            if response.has_arrived:
                row['settling'] = 1e3 * (response.seek_time - loose.first_entry)
            row['overshoot'] = response.overshoot
        return found


def measured(due: Sequence[SeekTrial], label: str, chunksize: int = 4) -> Measures:
    """Return the measures of trials with equal numbers of seeks, shape (trials, seeks), computed on all cores."""
    found: Any = on_trials(SeekTrial.measures, due, label, chunksize)
    return np.asarray(found)


def seek_trial(
    runs: RecordedRuns,
    case: Case,
    targets: Sequence[float],
    seed: int = 1,
    changes: Mapping[str, object] | None = None,
    dwell: float = DWELL,
) -> SeekTrial:
    """
    Return the repetition of a recorded run as a trial with other seeks.

    Parameters
    ----------
    runs, case
        Recorded run to repeat.
    targets
        Targets in the unit of the recorded ones; the head starts at rest at 0, the first seek after a dwell time.
    seed
        Seed of sensors and disturbances.
    changes
        Parameters that replace the recorded ones, under ``'node:parameter'``.
    dwell
        Time between seeks, rounded up to whole samples [s].
    """
    due = trial(
        runs,
        case,
        seed,
        {
            'reference_generator:start_time': dwell,
            f'{_SEEK}targets': tuple(float(target) for target in targets),
            f'{_SEEK}dwell_times': (dwell,),
            **(changes or {}),
        },
    )
    samples = math.ceil(dwell / due.sample_time - 1e-9)
    return SeekTrial(due.controller, due.sample_time, due.parameters, samples * (len(targets) + 1), due.sensor)


def random_seeks(
    runs: RecordedRuns, case: Case, count: int, dwell: float, seed: int, changes: Mapping[str, object] | None = None
) -> SeekTrial:
    """Return a trial with random seeks from 0.1 to 150 µm; see :func:`seek_trial` for the other arguments."""
    return seek_trial(
        runs,
        case,
        (1.0,) * count,
        seed,
        {
            f'{_SEEK}source': 'random',
            f'{_SEEK}track_pitch': 0.0,
            f'{_SEEK}seed': seed,
            f'{_SEEK}count': count,
            f'{_SEEK}shortest': 0.1,
            f'{_SEEK}longest': 150.0,
            f'{_SEEK}travel': 150.0,
            f'{_SEEK}repeat': False,
            **(changes or {}),
        },
        dwell,
    )


def from_rest_and_after_others(length: float) -> list[float]:
    """Return targets with six seeks of a length: both directions, from rest and after seeks of other lengths."""
    moves = [1.0, -1.0, -1.0, 0.37, 1.0, 1.0, -2.6, 1.0]
    targets: list[float] = np.cumsum(np.multiply(moves, length)).tolist()
    return targets


def of_length(found: Measures, length: float) -> Measures:
    """Return the measures of the seeks with a length [um], in either direction."""
    return np.asarray(found[np.abs(np.abs(found['length']) - length) < 1e-6 * length])


VARIED = [
    drive_changes(friction, gain, modes) for friction in (0.8, 1.2) for gain in (0.95, 1.05) for modes in (0.95, 1.05)
]
"""Overrides for the drives at the corners: friction +-20 %, gain +-5 %, mode frequencies +-5 %."""


def drawn_drive(seed: int) -> dict[str, object]:
    """Return overrides for a random drive, uniformly distributed between the corners."""
    draw = np.random.default_rng(seed)
    friction, gain, modes = (1.0 + spread * float(draw.uniform(-1.0, 1.0)) for spread in (0.2, 0.05, 0.05))
    return drive_changes(friction, gain, modes)
