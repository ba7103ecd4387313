"""Repetitions of recorded runs with other seeds, parameters or drives, without bags."""

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.campaign.all_cores import on_all_cores
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.graph.catalog import SENSORS
from hdd_servo_ros.messages.ticks import HALF_MICROSECOND
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.chapter5.random_drives import random_drive
from hdd_servo_ros.studies.mobile.cases import TRANSIENT

DURATION = 3.0
"""Duration of a trial in vibration [s]."""
Item = TypeVar('Item')
_SEEDED = ('disturbance_generator', 'ldv_sensor', 'servo_sensor', 'accelerometer')


@dataclasses.dataclass(frozen=True)
class Trial:
    """
    Run without recording.

    Attributes
    ----------
    controller
        Short name of the controller.
    sample_time
        T [s].
    parameters
        Parameters of all nodes, by node and name.
    duration
        Duration of the run [s].
    transient
        Transient before the error is evaluated [s].
    sensor
        ``'ldv'`` or ``'servo'``.
    """

    controller: str
    sample_time: float
    parameters: Mapping[str, Mapping[str, Any]]
    duration: float = DURATION
    transient: float = TRANSIENT
    sensor: str = 'ldv'

    def error(self) -> NDArray[np.float64]:
        """Return the track error at all ticks after the transient [nm]; not finite if the loop diverged."""
        ticks = round(self.duration / self.sample_time) + 1
        rows = Experiment(self.sample_time, self.controller, self.parameters, sensor=self.sensor).run(0, ticks)
        late = rows.time >= self.transient - HALF_MICROSECOND
        return np.asarray(NANOMETRES * rows.track_error[late])

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings that `rig` and `simulate` print before such a run."""
        return Experiment(self.sample_time, self.controller, self.parameters, sensor=self.sensor).warnings()

    def three_sigma(self) -> float:
        """Return three standard deviations of the error after the transient [nm]; NaN if the loop diverged."""
        return misregistration(self.error())


def trial(
    runs: RecordedRuns, case: Case, seed: int, changes: Mapping[str, object] | None = None, drive: int | None = None
) -> Trial:
    """
    Return the repetition of a recorded run as a trial.

    Parameters
    ----------
    runs, case
        Recorded run to repeat.
    seed
        Seed of the disturbances and sensors; replaces the recorded seeds.
    changes
        Parameters that replace the recorded ones, under ``'node:parameter'``.
    drive
        Number of a random drive (:func:`~hdd_servo_ros.studies.chapter5.random_drives.random_drive`); None for the
        recorded one.
    """
    parameters = {node: dict(values) for node, values in runs.parameters(case).items()}
    for node in _SEEDED:
        for name in parameters.get(node, {}):
            if name.rsplit('.', 1)[-1] == 'seed':
                parameters[node][name] = seed
    parameters = with_changes(parameters, changes or {})
    if drive is not None:
        parameters['vcm_plant'] = random_drive(parameters['vcm_plant'], drive)
    sensor = 'servo' if SENSORS['servo'] in parameters else 'ldv'
    return Trial(runs[case].controller, runs[case].sample_time, parameters, sensor=sensor)


def with_changes(
    parameters: Mapping[str, Mapping[str, Any]], changes: Mapping[str, object]
) -> dict[str, dict[str, Any]]:
    """Return the parameters of all nodes with some replaced; ``changes`` has keys ``'node:parameter'``."""
    changed = {node: dict(values) for node, values in parameters.items()}
    for key, value in changes.items():
        node, name = key.split(':')
        if name not in changed[node]:
            raise KeyError(f'{node} has no parameter {name}')
        changed[node][name] = value
    return changed


def on_trials(
    measure: Callable[[Item], Any], due: Sequence[Item], label: str, chunksize: int = 4
) -> NDArray[np.float64]:
    """Return ``measure`` of each trial, computed on all cores with a progress bar on a terminal."""
    found = on_all_cores(measure, due, chunksize)
    return np.array(list(tqdm(found, label, len(due), unit='run', disable=not sys.stderr.isatty())))


def quantile(values: NDArray[np.float64], share: float) -> float:
    """Return the smallest value that at least this share of the values does not exceed; NaN is the largest."""
    in_order = np.sort(np.where(np.isnan(values), np.inf, values), axis=None)
    return float(np.quantile(in_order, share, method='inverted_cdf'))


def median_and_tail(values: NDArray[np.float64]) -> str:
    """Return median and 95th percentile as tables show them."""
    return f'{quantile(values, 0.5):.3g} / {quantile(values, 0.95):.3g}'


def count(fulfilled: NDArray[np.bool_]) -> str:
    """Return the number of runs that satisfy a condition, as tables show it."""
    return f'{np.count_nonzero(fulfilled)} of {fulfilled.size}'
