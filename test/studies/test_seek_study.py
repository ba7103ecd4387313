"""Seek, settle, follow: results of the study, with a few of its seeds, drives and lengths."""

import dataclasses

import numpy as np
import pytest

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.seeks_of_run import responses_of
from hdd_servo_ros.simulation.simulate import main as simulate
from hdd_servo_ros.studies.chapter import figures, make_figures
from hdd_servo_ros.studies.seek import (
    fig_access,
    table_bounds,
    table_learning,
    table_methods,
    table_others,
    table_random,
    table_times,
)
from hdd_servo_ros.studies.seek.access_times import access_measures, median_and_worst
from hdd_servo_ros.studies.seek.cases import (
    BASE,
    BY_SECTORS,
    DWELL,
    FRICTIONS,
    IN_VIBRATION,
    LEARNED,
    LEARNED_AFTER,
    LEARNING_LENGTHS,
    NARROW,
    NARROW_LIMITS,
    OVERSHOOT_LIMITS,
    TOLERANCE,
    to_and_fro,
)
from hdd_servo_ros.studies.seek.learning import levels, narrow_times
from hdd_servo_ros.studies.seek.trials import from_rest_and_after_others, of_length, random_seeks, seek_trial


@pytest.fixture(scope='module')
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp('seek')
    cases = {case.name: case for figure in figures('seek').values() for case in figure.CASES}
    for name, case in cases.items():
        # In this process, because starting a process takes longer than one of these short runs.
        assert simulate(case.arguments({}, path / name)) == 0
    return path


@pytest.fixture(scope='module')
def runs(directory):
    return RecordedRuns(directory)


@pytest.mark.parametrize('case', [BASE['final_state'], BASE['cnf'], IN_VIBRATION], ids=lambda case: case.name)
def test_a_trial_with_the_recorded_seeks_is_the_recorded_run(runs, case):
    targets = runs.parameters(case)['reference_generator']['seek.targets']
    found = seek_trial(runs, case, targets).measures()
    for tolerance, name in ((TOLERANCE, 'time'), (NARROW, 'narrow_time')):
        recorded = [1e3 * response.seek_time for response in responses_of(runs[case], tolerance)]
        np.testing.assert_array_equal(found[name], recorded)
    assert found['length'].tolist() == [50.0, -50.0] * (len(targets) // 2)


def test_seeks_of_a_length_are_selected(runs):
    found = seek_trial(runs, BASE['final_state'], from_rest_and_after_others(10.0)).measures()
    assert len(found) == 8
    chosen = of_length(found, 10.0)
    assert sorted(chosen['length']) == pytest.approx([-10.0] * 2 + [10.0] * 4)
    assert chosen['time'].max() <= 1.1
    assert (found['time'] >= found['settling']).all()


def test_a_seek_that_does_not_arrive_is_reported():
    assert median_and_worst(np.array([1.0, 2.0, np.inf])) == '2.00 / none'


def test_random_seeks_follow_the_seed_and_all_arrive(runs):
    for case in (IN_VIBRATION, BY_SECTORS):
        one, same, other = (random_seeks(runs, case, 40, 0.02, seed).measures() for seed in (1, 1, 2))
        np.testing.assert_array_equal(one, same)
        assert len(one) == 40
        assert not np.array_equal(one['length'], other['length'])
        lengths = np.abs(one['length'])
        assert lengths.min() >= 0.1 * (1.0 - 1e-9)
        assert lengths.max() <= 150.0
        for found in (one, other):
            assert np.isfinite(found['time']).all()
    assert np.median(one['time']) < 1.0


def test_nominal_and_varied_drives_meet_the_limits(runs):
    found = table_times.by_kind(runs, (10.0, 100.0), 2, 2)
    assert len(found) == 6
    for (kind, length), seeks in found.items():
        assert len(seeks) == 6 * (8 if kind == 'corners' else 2)
        assert seeks['time'].max() <= table_times.limit_of(kind, length)
        assert seeks['overshoot'].max() <= OVERSHOOT_LIMITS['nominal' if kind == 'nominal' else 'varied']


def test_friction_is_learned_and_the_limits_are_met_then(runs):
    for length in LEARNING_LENGTHS:
        for friction in FRICTIONS:
            case = LEARNED[length, friction]
            times, level = narrow_times(runs, case), levels(runs, case)
            assert level[0] == 1.0
            assert level[LEARNED_AFTER:] == pytest.approx(friction, abs=0.03)
            assert times[LEARNED_AFTER:].max() <= NARROW_LIMITS[length][0 if friction == 1.0 else 1]
            if friction != 1.0:
                assert times[0] > 1.5 * times[-1]


def test_cnf_and_ptos_against_their_limits(runs):
    lengths = (50.0, 100.0, 1000.0)
    found = access_measures(runs, ('ptos', 'cnf', 'trajectory', 'pid'), lengths, 1)
    for length in lengths[:2]:
        for name in ('time', 'settling'):
            assert found['cnf', length][name].max() <= table_methods.CNF_LIMIT * found['ptos', length][name].max()
    # CNF is intended for short seeks.
    assert found['cnf', 1000.0]['time'].min() > found['ptos', 1000.0]['time'].max()
    # With the trajectory, the reference of the controller has no step.
    assert found['trajectory', 50.0]['time'].max() < 0.3 * found['pid', 50.0]['time'].min()


def rows(path):
    lines = path.read_text().splitlines()[4:]
    return [[cell.strip(' *') for cell in line.strip('|').split('|')] for line in lines]


def test_every_figure_and_table_is_made(directory, monkeypatch):
    for module in (fig_access, table_methods, table_others, table_learning):
        monkeypatch.setattr(module, 'SEEDS', 1)
    monkeypatch.setattr(fig_access, 'LENGTHS', (1.0, 10.0, 100.0))
    for module in (table_times, table_others):
        monkeypatch.setattr(module, 'LENGTHS', (10.0, 50.0))
    monkeypatch.setattr(table_times, 'SEEDS', 1)
    monkeypatch.setattr(table_times, 'DRIVES', 1)
    monkeypatch.setattr(table_random, 'SEEKS', 80)
    made = figures('seek')
    paths = {path.stem: path for path in make_figures(made, directory)}
    assert set(paths) == set(made)
    for path in paths.values():
        assert path.suffix in ('.png', '.md')
        assert 100 < path.stat().st_size < 300_000, path
    assert [row[5] for row in rows(paths['table_times'])] == ['met'] * 6
    random = rows(paths['table_random'])
    assert [row[2] for row in random] == [row[3] for row in random]
    assert [row[2] for row in random if row[1] == '0.1 to 150'] == ['80'] * len(table_random.RUNS)
    methods = {row[0]: row for row in rows(paths['table_methods'])}
    assert [methods[length][5] for length in ('100', '150', '1000')] == ['2.5: met', '2.5: met', '1.7: met']
    assert [methods[length][10] for length in ('50', '100', '1000')] == ['met', 'met', 'not met']
    learning = rows(paths['table_learning'])
    assert [row[6].split()[-1] for row in learning if row[6]] == ['met'] * 6
    assert len(rows(paths['table_bounds'])) == len(table_bounds.LENGTHS)


def test_the_recorded_seeks_begin_after_a_dwell_time(runs):
    run = runs[BASE['final_state']]
    assert run.duration == pytest.approx(DWELL * 3)
    assert to_and_fro(50.0, 3) == (50.0, 0.0, 50.0)
    first = responses_of(run, TOLERANCE)[0]
    assert first.time == pytest.approx(DWELL)
    assert dataclasses.asdict(first.seek) == {'row': 300, 'origin': 0.0, 'target': 50.0}
