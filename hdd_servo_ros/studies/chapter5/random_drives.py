"""Many drives drawn about the nominal one, and how well recorded controllers do on them; these runs leave no bags."""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from hdd_servo_ros.analysis.metrics import NANOMETRES, tracking_metrics
from hdd_servo_ros.campaign.all_cores import on_all_cores
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.chapter5.cases import TRANSIENT

SPREAD = 0.2
"""Each quantity is drawn within this part of its nominal value, all values alike."""
BOUND = 1000.0
"""A run is bounded if its error never exceeds this, from first to last tick [nm]: half of the sine's amplitude."""
FRICTION = ('stiffness', 'bristle_damping', 'viscous_coefficient', 'coulomb_level', 'static_level', 'stribeck_velocity')


def random_drive(nominal: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """
    Return the parameters of a drive about a nominal one with LuGre friction and resonances in sections.

    Drawn are the gain, the six numbers of the friction, and of each mode the frequency w and the damping: denominator
    and numerator of its section are scaled alike, s^1 by both and s^0 by w^2. Each is drawn by itself, but a static
    level below the Coulomb level is raised to it.

    Parameters
    ----------
    nominal
        Parameters of `vcm_plant`.
    seed
        Number of the drive.
    """
    draw = np.random.default_rng(seed)

    def factor() -> float:
        return float(1.0 + SPREAD * draw.uniform(-1.0, 1.0))

    drive = dict(nominal)
    drive['gain'] *= factor()
    for name in FRICTION:
        drive[f'friction.{name}'] *= factor()
    drive['friction.static_level'] = max(drive['friction.static_level'], drive['friction.coulomb_level'])
    numerators = np.array(drive['resonance.numerators']).reshape(-1, 3)
    denominators = np.array(drive['resonance.denominators']).reshape(-1, 3)
    for section in range(len(denominators)):
        frequency, damping = factor(), factor()
        for coefficients in (numerators, denominators):
            coefficients[section] *= (1.0, frequency * damping, frequency**2)
    drive['resonance.numerators'] = tuple(numerators.ravel().tolist())
    drive['resonance.denominators'] = tuple(denominators.ravel().tolist())
    return drive


@dataclasses.dataclass(frozen=True)
class Trial:
    """
    One run on one random drive.

    Attributes
    ----------
    controller
        Short name.
    sample_time
        T [s].
    last_tick
        How long it lasts.
    parameters
        Of all nodes, by name, those of the drive still nominal.
    seed
        Number of the drive.
    """

    controller: str
    sample_time: float
    last_tick: int
    parameters: Mapping[str, Mapping[str, Any]]
    seed: int

    def errors(self) -> tuple[float, float, float]:
        """Return rms and largest error after the transient, and the largest of the whole run [nm], or NaN."""
        drive = random_drive(self.parameters['vcm_plant'], self.seed)
        experiment = Experiment(self.sample_time, self.controller, {**self.parameters, 'vcm_plant': drive})
        rows = experiment.run(0, self.last_tick + 1)
        found = tracking_metrics(
            rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], TRANSIENT, NANOMETRES
        )
        ever = NANOMETRES * float(np.abs(rows.head[:, 0] - rows.reference[:, 0]).max())
        return found.rms_error, found.max_error, ever


def trials(runs: RecordedRuns, case: Case, drives: int) -> list[Trial]:
    """Return a recorded run's trials on so many drives."""
    run = runs[case].description
    fixed = (run['controller'], run['sample_time'], run['last_tick'], runs.parameters(case))
    return [Trial(*fixed, seed) for seed in range(drives)]


def errors_on_random_drives(waiting: Sequence[Trial]) -> list[tuple[float, float, float]]:
    """Return what :meth:`Trial.errors` says of each trial, by all cores, with progress and time left on a terminal."""
    results = on_all_cores(Trial.errors, waiting, chunksize=4)
    return list(tqdm(results, 'random drives', len(waiting), unit='run', disable=not sys.stderr.isatty()))
