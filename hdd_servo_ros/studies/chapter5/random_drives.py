"""Campaign with the controllers of recorded runs on random drives around the nominal one."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.points import Varied
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.campaign.spec import CampaignController, Spec, named_values
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.studies.chapter5.cases import TRANSIENT

SPREAD = 0.2
"""Relative half-width of the uniform distribution of each parameter around its nominal value."""
BOUND = 1000.0
"""A run is bounded if its error never exceeds this at any tick [nm]: half the amplitude of the sine."""
FRICTION = ('stiffness', 'bristle_damping', 'viscous_coefficient', 'coulomb_level', 'static_level', 'stribeck_velocity')

DRAWN = ('gain', *(f'friction.{name}' for name in FRICTION), 'resonance.numerators', 'resonance.denominators')
"""Parameters that differ between the drives."""
_METRICS = ('rms_error', 'max_error', f'{__name__}:largest_error')


def random_drive(nominal: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """
    Return the parameters of a random drive around a nominal one with LuGre friction and second-order sections.

    The gain, the six friction parameters, and the frequency w and damping of each mode are drawn independently. In the
    numerator and the denominator of the section of a mode, s^1 is scaled by both factors and s^0 by that of w^2. A
    static friction below the Coulomb friction is raised to it.

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


def largest_error(run: RecordedRun) -> float:
    """Return the largest error of the entire run [nm]; a metric of the campaign."""
    return NANOMETRES * float(np.abs(run.position - run.desired_position).max())


def campaign_on_drives(runs: RecordedRuns, cases: Sequence[Case], drives: Sequence[int]) -> Campaign:
    """
    Return the campaign that repeats recorded runs on random drives; its controllers have the names of the cases.

    Parameters
    ----------
    runs, cases
        Recorded runs, all with the same nominal drive.
    drives
        Numbers of the drives, used as seeds.

    Raises
    ------
    ValueError
        If the nominal drives differ.
    """
    nominal = runs.parameters(cases[0])['vcm_plant']
    for case in cases:
        if runs.parameters(case)['vcm_plant'] != nominal:
            raise ValueError(f'the drives of {case.name} and {cases[0].name} differ')
    points = []
    for number in drives:
        drawn = random_drive(nominal, number)
        points.append({f'vcm_plant:{name}': Varied(drawn[name]) for name in DRAWN})
    return Campaign(
        Spec(
            'random drives',
            controllers=tuple(_recorded(runs, case) for case in cases),
            points=points,
            metrics=_METRICS,
            after=TRANSIENT,
        )
    )


def _recorded(runs: RecordedRuns, case: Case) -> CampaignController:
    """Return the controller of a recorded run with all parameters of the run."""
    sections = {node: values for node, values in runs.parameters(case).items() if node != 'bag_recorder'}
    return CampaignController(case.name, runs[case].controller, values=named_values(sections))


def errors_on_random_drives(runs: RecordedRuns, cases: Sequence[Case], drives: Sequence[int]) -> NDArray[np.float64]:
    """
    Return the errors of recorded runs on random drives from a campaign, with a progress bar on a terminal.

    Parameters
    ----------
    runs, cases, drives
        See :func:`campaign_on_drives`.

    Returns
    -------
    NDArray
        rms and maximum error after the transient, and largest error of the entire run [nm]; NaN if the run diverged;
        shape (cases, drives, 3).
    """
    table = campaign_on_drives(runs, cases, drives).run(progress=sys.stderr.isatty())
    found: NDArray[np.float64] = np.stack([table[name] for name in _METRICS], axis=-1)
    # The samples before a divergence do not give a valid error.
    found[table['status'] != FINISHED] = np.nan
    return np.asarray(found.reshape(len(drives), len(cases), len(_METRICS)).transpose(1, 0, 2))
