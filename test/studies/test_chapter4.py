"""Section 4.4 from bags: expected results, with ranges confirmed by an independent implementation."""

import numpy as np
import pytest

from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.campaign.runner import run_cases
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.studies.chapter import figures, make_figures
from hdd_servo_ros.studies.chapter4.cases import (
    COMPARED_LAMBDAS,
    FEEDFORWARD_BY_LAMBDA,
    LAMBDAS,
    LAST_HALF,
    NN,
    NN_BY_LAMBDA,
    PID_BY_LAMBDA,
    at_sample_time,
)
from hdd_servo_ros.studies.chapter4.network_cases import as_printed, compensator, network, phi_only, without
from hdd_servo_ros.studies.chapter4.table_ablation import ABLATION
from hdd_servo_ros.studies.chapter4.table_lambda import NN_COARSE

COARSE = {'deterministic_timer:sample_time': 1e-3}
FINE = at_sample_time(NN, 1e-4)


@pytest.fixture(scope='module')
def directory(tmp_path_factory):
    """All runs of the study at T = 1 ms, and one at the parameter file's 0.1 ms."""
    path = tmp_path_factory.mktemp('chapter4')
    cases = [case for figure in figures('chapter4').values() for case in figure.CASES]
    again = {case.name for case in NN_COARSE.values()}
    cases = [case for case in cases if case.name not in again]
    run_cases([FINE, *cases], path, without_ros=True, defaults=COARSE, report=lambda line: None)
    for value, case in NN_COARSE.items():
        (path / case.name).symlink_to(NN_BY_LAMBDA[value].name)
    return path


@pytest.fixture(scope='module')
def runs(directory):
    return RecordedRuns(directory)


def errors(runs, cases):
    return {key: runs.metrics(case, LAST_HALF).rms_error for key, case in cases.items()}


def assert_section_4_4(runs, case):
    found = runs.metrics(case, LAST_HALF)
    assert 0.0027 < found.rms_error < 0.0041
    assert 0.0055 < found.max_error < 0.0083
    run = runs[case]
    assert run.duration == 20.0
    assert abs(run.estimates['m_hat'][run.since(LAST_HALF)].mean() - 1.0) < 0.05
    for name, largest in {'sigma_hat': 1.0, 'm_hat': 3.0, 'phi_hat': 1.0, 'W_norm': 1.0}.items():
        assert np.abs(run.estimates[name]).max() < largest, name


@pytest.mark.parametrize('case', [NN, FINE], ids=['T1e-3', 'T1e-4'])
def test_lambda_1(runs, case):
    assert_section_4_4(runs, case)


def test_lambda_1_through_the_graph(bench, monkeypatch, directory, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(bench.domain))
    run_cases([NN], tmp_path, defaults=COARSE, report=lambda line: None)
    assert_section_4_4(RecordedRuns(tmp_path), NN)
    assert compare_bags([str(tmp_path / NN.name), str(directory / NN.name)]) == 0


def test_the_error_falls_and_the_peak_grows_with_lambda(runs):
    found = list(errors(runs, NN_BY_LAMBDA).values())
    assert found == sorted(found, reverse=True)
    assert len(set(found)) == len(LAMBDAS)
    peaks = {value: runs.metrics(case, LAST_HALF).peak_control for value, case in NN_BY_LAMBDA.items()}
    assert peaks[15.0] > 1.4 * peaks[10.0] > 1.4 * 1.4 * peaks[5.0]
    small = [peaks[value] for value in LAMBDAS if value <= 2.0]
    assert max(small) < 1.1 * min(small)
    assert peaks[5.0] > 1.3 * max(small)


def test_two_sample_times_agree(runs):
    fine, coarse = (runs.metrics(case, LAST_HALF).rms_error for case in (FINE, NN))
    assert coarse == pytest.approx(fine, rel=0.05)


@pytest.mark.parametrize(('value', 'least'), [*zip(COMPARED_LAMBDAS, (20.0, 2.5, 1.05), strict=True)])
def test_pid_under_the_same_peak(runs, value, least):
    own = runs.metrics(NN_BY_LAMBDA[value], LAST_HALF)
    pid = runs.metrics(PID_BY_LAMBDA[value], LAST_HALF)
    assert pid.peak_control == pytest.approx(own.peak_control, rel=0.05)
    assert pid.rms_error > least * own.rms_error


def test_feedforward_of_the_true_mass(runs):
    """With feedforward, PID has the smaller error from lambda = 10 on."""
    own, other = errors(runs, NN_BY_LAMBDA), errors(runs, FEEDFORWARD_BY_LAMBDA)
    assert other[1.0] > 3.0 * own[1.0]
    assert other[10.0] < 0.7 * own[10.0]
    assert other[15.0] < 0.35 * own[15.0]


def test_ablation(runs):
    found = errors(runs, ABLATION)
    over = {label: error / found['full'] for label, error in found.items()}
    assert over['only -k r'] > over['without m_hat'] > 40.0
    assert 3.0 < over['without sigma_hat'] < 6.0
    assert 1.05 < over['without phi_hat'] < over['without both'] < 1.25
    assert over['without network'] == pytest.approx(1.0, abs=0.01)
    assert over['adaptive widths'] == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(('value', 'share'), [(1.0, 0.6), (10.0, 0.4)])
def test_when_the_network_helps(runs, value, share):
    cases = {
        'none': without(value),
        'printed': as_printed(value),
        'strong': network(value, normalized=False),
        'normalized': network(value, normalized=True),
    }
    found = errors(runs, cases)
    assert found['printed'] == pytest.approx(found['none'], rel=0.02)
    assert found['normalized'] < 0.8 * found['strong'] < 0.8 * found['none']
    assert found['normalized'] < share * found['none']
    # phi_hat with the same constants reaches the same error, with more chatter.
    instead = phi_only(value)
    assert runs.metrics(instead, LAST_HALF).rms_error < 1.2 * found['normalized']
    assert runs.chatter(cases['normalized'], LAST_HALF) < 0.5 * runs.chatter(instead, LAST_HALF)


@pytest.mark.parametrize('value', [1.0, 10.0])
def test_the_compensator_under_the_thesis_constants(runs, value):
    own, other = (runs.metrics(case, LAST_HALF) for case in (NN_BY_LAMBDA[value], compensator(value, slow=False)))
    assert other.rms_error < 0.6 * own.rms_error
    assert other.peak_control < 1.1 * own.peak_control


def test_every_figure_and_table_is_made(directory):
    made = figures('chapter4')
    paths = make_figures(made, directory)
    assert {path.stem for path in paths} == set(made)
    for path in paths:
        assert path.suffix in ('.png', '.md')
        assert 100 < path.stat().st_size < 150_000, path
    ablation = (directory / 'figures' / 'table_ablation.md').read_text()
    assert all(f'| {label} | ' in ablation for label in ABLATION)
