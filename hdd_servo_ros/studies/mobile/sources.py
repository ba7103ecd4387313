"""Contribution of each source to the track error, from repetitions of recorded runs without the source."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from hdd_servo_ros.analysis.error_spectrum import error_by_source
from hdd_servo_ros.analysis.misregistration import misregistration
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.graph.error_sources import error_sources
from hdd_servo_ros.studies.mobile.cases import DURATION, FILE, TRANSIENT, method_of
from hdd_servo_ros.studies.mobile.trials import Trial, on_trials, trial

SEEDS = 5
_NSS = 'nss_100ktpi.yaml'
_NSS_TRANSIENT = 0.5


def _mobile(name: str, method: str) -> Case:
    overrides = {'deterministic_timer:duration': DURATION, method_of('pid'): method}
    return Case(f'sources_{name}_{method}', 'pid', (FILE, f'mobile_{name}.yaml'), overrides)


CASES_BY_NAME: dict[str, Case] = {
    'NSS disturbances, servo sensor, 26.4 kHz': Case('sources_nss', 'pid', (FILE, _NSS), {}),
    'the same, 10.08 kHz': Case(
        'sources_nss_10_khz', 'pid', (FILE, _NSS, 'nss_100ktpi_10_khz.yaml'), {'rig:sensor': 'servo'}
    ),
    'walking, no feedforward': _mobile('walking', 'none'),
    'walking, fxlms': _mobile('walking', 'fxlms'),
    'car, no feedforward': _mobile('car', 'none'),
    'car, fxlms': _mobile('car', 'fxlms'),
}


@dataclasses.dataclass(frozen=True)
class Contributions:
    """3 sigma of the track error with all sources, and contribution of each source [nm]."""

    total: float
    by_source: Mapping[str, float]


def contributions(runs: RecordedRuns, seeds: int) -> dict[str, Contributions]:
    """Return the contributions in each of :data:`CASES_BY_NAME` over a number of seeds."""
    return {name: _of_case(runs, name, case, seeds) for name, case in CASES_BY_NAME.items()}


def _of_case(runs: RecordedRuns, name: str, case: Case, seeds: int) -> Contributions:
    switches = {source: {f'{n}:{p}': off} for source, (n, p, off) in error_sources(runs.parameters(case)).items()}
    due = [_trial(runs, case, seed, changes) for changes in ({}, *switches.values()) for seed in range(1, seeds + 1)]
    # Remove the mean of each run, which does not belong to sigma.
    errors = [error - error.mean() for error in on_trials(Trial.error, due, name, chunksize=1)]
    complete, *without = (np.concatenate(part) for part in np.split(np.array(errors), len(switches) + 1))
    return Contributions(
        misregistration(complete), error_by_source(complete, dict(zip(switches, without, strict=True)))
    )


def _trial(runs: RecordedRuns, case: Case, seed: int, changes: Mapping[str, object]) -> Trial:
    made = trial(runs, case, seed, changes)
    if made.sensor == 'servo':
        return dataclasses.replace(made, duration=runs[case].duration, transient=_NSS_TRANSIENT)
    return dataclasses.replace(made, duration=runs[case].duration, transient=min(TRANSIENT, 0.5 * runs[case].duration))
