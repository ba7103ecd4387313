"""Baseline from bags: best PID controllers, and comparison with the adaptive NN controller."""

import dataclasses
import itertools
import math

import pytest

from hdd_servo_ros.analysis.metrics import NANOMETRES
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.campaign.case import parameter_file
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.simulate import main as simulate
from hdd_servo_ros.studies.baseline.cases import (
    BEST_PID_SINES,
    BEST_PID_STEPS,
    BEST_PIDS,
    FILE,
    FOR_SINES,
    HEIGHTS,
    LIMIT_FREQUENCIES,
    OVER_AMPLITUDE,
    OVER_FREQUENCY,
    PID_NAMES,
)
from hdd_servo_ros.studies.chapter import figures, make_figures
from hdd_servo_ros.studies.tuning_runs import Steps, track

T = 1e-4
SECTIONS = read_parameter_files([parameter_file(FILE)])
SHORT = 2.3
"""Duration of runs that are only drawn; the transient is two seconds [s]."""


def gains_of(limit):
    return dict(zip(PID_NAMES, BEST_PIDS[limit], strict=True))


@pytest.mark.parametrize(('limit', 'overlays'), [(20.0, ()), (math.inf, (FOR_SINES,))])
def test_two_limits_have_shipped_parameter_files(limit, overlays):
    shipped = read_parameter_files([parameter_file(name) for name in (FILE, *overlays)])['pid_controller']
    assert {name: shipped[name] for name in PID_NAMES} == gains_of(limit)


@pytest.mark.parametrize('limit', BEST_PIDS)
def test_each_satisfies_the_rule_up_to_its_limit(limit):
    proportional, integral, derivative, bandwidth = BEST_PIDS[limit]
    law = LinearController(proportional, derivative, integral, bandwidth)
    assert 1.99 < LoopMargins(PlantParameters(), T).peak_sensitivity(law) <= 2.0
    assert Steps(SECTIONS, T).overshoot(gains_of(limit)) <= limit


def test_more_overshoot_allows_less_error():
    """A higher limit never increases the squared error by more than the 5 % allowed for the integral."""
    squares = [
        sum(track('pid', gains_of(limit), SECTIONS, T, f, 4.0, 2.0).rms_error ** 2 for f in (100.0, 200.0))
        for limit in BEST_PIDS
    ]
    assert sorted(BEST_PIDS) == [*BEST_PIDS]
    assert all(more < 1.05 * less for less, more in itertools.pairwise(squares))
    assert squares[-1] < 0.2 * squares[0]


def test_every_figure_and_table_is_made(tmp_path):
    made = figures('baseline')
    cases = {case.name: case for figure in made.values() for case in figure.CASES}
    steps = {case.name for by_height in BEST_PID_STEPS.values() for case in by_height.values()}
    for name, case in cases.items():
        duration = {} if name in steps else {'deterministic_timer:duration': SHORT}
        short = dataclasses.replace(case, overrides={**case.overrides, **duration})
        # In this process, because starting a process takes longer than one of these short runs.
        assert simulate(short.arguments({}, tmp_path / name)) == 0
    paths = make_figures(made, tmp_path)
    assert {path.stem for path in paths} == set(made)
    for path in paths:
        assert path.suffix in ('.png', '.md')
        assert 100 < path.stat().st_size < 150_000, path
    runs = RecordedRuns(tmp_path)
    lines = (tmp_path / 'figures' / 'table_overshoot.md').read_text().splitlines()[4:]
    assert len(lines) == len(BEST_PIDS)
    for line, (limit, by_frequency) in zip(lines, BEST_PID_SINES.items(), strict=True):
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        errors = [runs.metrics(by_frequency[f], 2.0, NANOMETRES).rms_error for f in LIMIT_FREQUENCIES]
        assert cells[5:8] == [f'{error:.3g}' for error in errors]
        assert float(cells[8]) <= limit
    for name, compared in (('table_frequency', OVER_FREQUENCY), ('table_amplitude', OVER_AMPLITUDE)):
        text = (tmp_path / 'figures' / f'{name}.md').read_text()
        for value, case in compared['PID for sines'].items():
            found = runs.metrics(case, 2.0, NANOMETRES)
            row = next(line for line in text.splitlines() if line.startswith(f'| {value:g} |'))
            assert f' {found.rms_error:.3g} / {found.max_error:.3g} ' in row
    assert {height for by_height in BEST_PID_STEPS.values() for height in by_height} == set(HEIGHTS)
