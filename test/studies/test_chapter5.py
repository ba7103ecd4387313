"""Chapter 5 from bags: expected results with the default noise, in runs of at least 10 s."""

import dataclasses
import itertools

import numpy as np
import pytest

from hdd_servo_ros.analysis.metrics import NANOMETRES, rms, step_response, tracking_metrics
from hdd_servo_ros.analysis.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.campaign.runner import run_cases
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.chapter import figures, make_figures
from hdd_servo_ros.studies.chapter5 import random_drives, table_random_drives
from hdd_servo_ros.studies.chapter5.cases import (
    FREQUENCIES,
    HEIGHTS,
    HYSTERESIS,
    HYSTERESIS_FREQUENCY,
    HYSTERESIS_OFF,
    HYSTERESIS_ON,
    HYSTERESIS_PID,
    LAMBDA_SINES,
    LAMBDA_STEPS,
    LAMBDAS,
    LAW_FROM_REST,
    LAW_STEPS,
    NN,
    PID,
    PID_FOR_SINES,
    PID_FOR_SINES_DELAY,
    PID_FOR_SINES_FROM_REST,
    PID_FOR_SINES_STEPS,
    PID_FROM_REST,
    PID_SAME_GAINS,
    PID_STEPS,
    SHIPPED,
    SHIPPED_DELAY,
    SHIPPED_FROM_REST,
    SHIPPED_STEPS,
    TRANSIENT,
)
from hdd_servo_ros.studies.chapter5.measures import START, edges, error, error_after_edges, loop_areas
from hdd_servo_ros.studies.chapter5.random_drives import BOUND, errors_on_random_drives, random_drive
from hdd_servo_ros.studies.chapter5.table_lambda import peak_sensitivity
from hdd_servo_ros.studies.chapter5.thesis_gains_cases import MAGNITUDES, PRINTED_SIGNS

WITHOUT_SIGMA, ONLY_SIGMA = (HYSTERESIS[name] for name in ('without sigma_hat', 'only sigma_hat'))
SHORT = 2.5
DRIVES = 24
LEAST_TIME = 10.0


def asserted_cases():
    squares = (LAW_STEPS, SHIPPED_STEPS, PID_STEPS, PID_FOR_SINES_STEPS, LAMBDA_STEPS)
    by_key = (
        NN,
        PID,
        PID_FOR_SINES,
        PID_FOR_SINES_DELAY,
        PID_FOR_SINES_FROM_REST,
        PID_SAME_GAINS,
        SHIPPED_DELAY,
        *squares,
        SHIPPED_FROM_REST,
        PID_FROM_REST,
        LAW_FROM_REST,
        LAMBDA_SINES,
    )
    cases = [case for cases in by_key for case in cases.values()]
    hysteresis = (HYSTERESIS_OFF, HYSTERESIS_ON, WITHOUT_SIGMA, ONLY_SIGMA)
    return [*cases, *SHIPPED.values(), *hysteresis, MAGNITUDES[100.0]]


def short(case):
    return dataclasses.replace(case, overrides={**case.overrides, 'deterministic_timer:duration': SHORT})


def kind(case):
    return case.controller, case.overrides.get('reference_generator:waveform')


def drawn():
    """Return the figures and tables except those with long runs: sweeps, and one minute of a sine."""
    left_out = ('fig_5_3', 'fig_5_4', 'table_identification', 'table_minute')
    return {name: figure for name, figure in figures('chapter5').items() if name not in left_out}


@pytest.fixture(scope='module')
def directory(tmp_path_factory):
    """Make the runs with assertions; for the others, link a short or similar run, so that figures can be drawn."""
    path = tmp_path_factory.mktemp('chapter5')
    judged = {case.name: case for case in asserted_cases()}
    kinds = {kind(case): name for name, case in judged.items()}
    others = {case.name: case for figure in drawn().values() for case in figure.CASES if case.name not in judged}
    shorts = [short(case) for case in others.values() if kind(case) not in kinds or case == PRINTED_SIGNS]
    run_cases([*judged.values(), *shorts], path, without_ros=True, report=lambda line: None)
    for name, case in others.items():
        if not (path / name).exists():
            (path / name).symlink_to(kinds[kind(case)])
    return path


@pytest.fixture(scope='module')
def runs(directory):
    return RecordedRuns(directory)


def on_sine(runs, case):
    assert runs[case].time[-1] >= LEAST_TIME
    return runs.metrics(case, TRANSIENT, NANOMETRES)


@pytest.mark.parametrize(
    ('frequency', 'rms_limit', 'max_limit', 'of_pid', 'of_same_gains'),
    [(100.0, 8.0, 35.0, 0.25, 0.08), (200.0, 6.5, 25.0, 0.15, 0.05)],
)
def test_sine(runs, frequency, rms_limit, max_limit, of_pid, of_same_gains):
    found = on_sine(runs, NN[frequency])
    assert found.rms_error < rms_limit
    assert found.max_error < max_limit
    assert found.rms_error < of_pid * on_sine(runs, PID[frequency]).rms_error
    assert found.rms_error < of_same_gains * on_sine(runs, PID_SAME_GAINS[frequency]).rms_error
    # At 100 Hz, the best PID without a limit of the overshoot has the smaller rms error and the larger maximum.
    for_sines = on_sine(runs, PID_FOR_SINES[frequency])
    assert for_sines.rms_error < 0.5 * on_sine(runs, PID[frequency]).rms_error
    assert (found.rms_error < for_sines.rms_error) == (frequency == 200.0)
    assert found.max_error < for_sines.max_error
    late = on_sine(runs, SHIPPED_DELAY[frequency])
    assert late.rms_error < 1.5 * on_sine(runs, SHIPPED[frequency]).rms_error
    # The estimates remain bounded, and the error in the last second does not exceed that in the third.
    run = runs[NN[frequency]]
    e = error(run)
    third = rms(e[(run.time >= 2.0) & (run.time < 3.0)])
    assert rms(e[run.time >= run.time[-1] - 1.0]) < 1.05 * third


def test_the_pid_for_sines_with_a_sample_of_delay_satisfies_the_rule(runs):
    """It has no parameter file; the documentation lists its gains."""
    case = PID_FOR_SINES_DELAY[100.0]
    gains = runs.parameters(case)['pid_controller']
    law = LinearController(
        gains['proportional_gain'],
        gains['derivative_gain'],
        gains['integral_gain'],
        gains['derivative_bandwidth'],
        gains['dsp.computation_delay'],
    )
    assert gains['dsp.computation_delay'] == 1
    assert 1.99 < LoopMargins(PlantParameters(), 1e-4).peak_sensitivity(law) <= 2.0
    assert on_sine(runs, case).rms_error < 48.0


def test_sine_through_the_graph(bench, monkeypatch, directory, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(bench.domain))
    """The first seconds, which are sufficient to compare the two runs."""
    case = short(NN[100.0])
    run_cases([case], tmp_path, report=lambda line: None)
    assert RecordedRuns(tmp_path).metrics(case, TRANSIENT, NANOMETRES).rms_error < 8.0
    last_tick = round(SHORT / 1e-4)
    assert first_difference(tmp_path / case.name, directory / case.name, last_tick) is None


@pytest.mark.parametrize('frequency', FREQUENCIES)
def test_the_shipped_controller_removes_the_third_harmonic(runs, frequency):
    """The law of the thesis leaves the third harmonic of the friction; desired compensation removes it."""
    own = on_sine(runs, SHIPPED[frequency])
    assert own.rms_error < 1.6
    assert own.rms_error < 0.6 * on_sine(runs, NN[frequency]).rms_error
    assert own.rms_error < 0.25 * on_sine(runs, PID_FOR_SINES[frequency]).rms_error


@pytest.mark.parametrize('frequency', FREQUENCIES)
def test_the_shipped_controller_remains_stable_for_a_minute(runs, frequency):
    """Without the bag of the study, which has 300 MB; the loop is the same, and equals the shorter bag at its end."""
    case = SHIPPED[frequency]
    rows = Experiment(1e-4, 'adaptive_nn', runs.parameters(case)).run(0, 600_001)
    e = (rows.head[:, 0] - rows.reference[:, 0]) * NANOMETRES
    np.testing.assert_array_equal(rows.head[:100_001], runs[case].head)
    assert rms(e[-10_000:]) < 1.6
    assert np.abs(e[20_000:]).max() < 10.0


SETTLING_LIMITS = dict(zip(HEIGHTS, (3e-3, 2e-3), strict=True))
FROM_REST = (SHIPPED_FROM_REST, PID_FROM_REST, LAW_FROM_REST)
SQUARES = (SHIPPED_STEPS, PID_STEPS, LAW_STEPS)


@pytest.mark.parametrize('height', HEIGHTS)
@pytest.mark.parametrize(('cases', 'count'), [(FROM_REST, 1), (SQUARES, 199)], ids=['from rest', 'square wave'])
def test_steps(runs, height, cases, count):
    assert all(runs[by_height[height]].time[-1] >= LEAST_TIME for by_height in cases)
    own, pid, law = (edges(runs[by_height[height]]) for by_height in cases)
    assert len(own) == count
    worst, of_pid = own.worst(), pid.worst()
    assert worst['overshoot'] < 3.0
    assert worst['settling_time'] < SETTLING_LIMITS[height]
    assert worst['steady_error'] < 3e-3
    assert worst['overshoot'] < 0.1 * of_pid['overshoot']
    # The noise contributes half a nanometer.
    assert worst['steady_error'] < of_pid['steady_error'] + 5e-4
    assert worst['settling_time'] < of_pid['settling_time'] + 0.5e-4
    for_sines = PID_FOR_SINES_FROM_REST if count == 1 else PID_FOR_SINES_STEPS
    assert 80.0 < edges(runs[for_sines[height]]).worst()['overshoot'] < 90.0
    assert of_pid['overshoot'] < 20.5
    # The law of the thesis does not overshoot, and leaves an error of more than a tenth of the step.
    assert law.worst()['overshoot'] == 0.0
    assert law.median()['steady_error'] > 0.1 * height


@pytest.mark.parametrize('height', HEIGHTS)
def test_steps_from_rest_in_both_directions_and_at_any_time(runs, height):
    """Several seeds and times, without bags; the last step is at the first tick."""
    nodes = runs.parameters(SHIPPED_FROM_REST[height])
    for index, start_time in enumerate((1.0, 2.0, 3.3333, 0.05, 0.5, 0.0)):
        step = {'waveform': 'step', 'amplitude': height * (-1) ** index, 'start_time': start_time}
        ldv = {**nodes['ldv_sensor'], 'seed': index}
        changed = {**nodes, 'reference_generator': step, 'ldv_sensor': ldv}
        rows = Experiment(1e-4, 'adaptive_nn', changed).run(0, round((start_time + 0.5) / 1e-4))
        found = step_response(rows.time, rows.reference[:, 0], rows.head[:, 0]).worst()
        assert found['overshoot'] < 3.0
        assert found['settling_time'] < SETTLING_LIMITS[height]
        assert found['steady_error'] < 3e-3


def test_lambda(runs):
    assert [*LAMBDA_SINES] == [*LAMBDAS]
    sines = [runs[case] for case in LAMBDA_SINES.values()]
    squares = [runs[case] for case in LAMBDA_STEPS.values()]
    assert min(run.time[-1] for run in (*sines, *squares)) >= LEAST_TIME

    def falls(values):
        return all(after < 0.9 * before for before, after in itertools.pairwise(values))

    assert falls([rms(error(run)[run.time < START]) for run in sines])
    assert falls([error_after_edges(run) for run in squares])
    peaks = [runs.metrics(case, 0.0).peak_control for case in LAMBDA_STEPS.values()]
    assert falls(peaks[::-1])
    # The error after adaptation increases slightly.
    adapted = [on_sine(runs, case).rms_error for case in LAMBDA_SINES.values()]
    assert adapted == sorted(adapted)
    assert adapted[-1] < 1.6 * adapted[0]
    assert max(peak_sensitivity(runs, case) for case in LAMBDA_SINES.values()) < 2.02


def test_hysteresis(runs):
    off, on = (loop_areas(runs[case]) for case in (HYSTERESIS_OFF, HYSTERESIS_ON))
    assert off.feedback == pytest.approx(off.command, rel=1e-12)
    assert 0.0 < on.feedback < 0.1 * off.feedback
    # Feedforward replaces feedback: the loop of the command is that of the friction, and grows.
    assert on.command > 1.5 * off.command
    assert on.command > on.friction > 0.9 * on.command
    # sigma_hat alone achieves the reduction.
    assert loop_areas(runs[WITHOUT_SIGMA]).feedback > off.feedback
    assert loop_areas(runs[ONLY_SIGMA]).feedback < 0.02 * off.feedback
    # The leakage of sigma_hat causes the remainder.
    law = runs.parameters(HYSTERESIS_ON)['adaptive_nn_controller']
    sigma = runs[HYSTERESIS_ON].estimates['sigma_hat'][-20_000:].mean()
    asked = law['feedback_gain'] * law['sigma.leakage'] * sigma / HYSTERESIS_FREQUENCY
    assert on.feedback == pytest.approx(asked, rel=0.05)


def test_the_gains_of_section_5_5(runs):
    """The printed gains diverge at once; their magnitudes work on this sine."""
    assert on_sine(runs, MAGNITUDES[100.0]).rms_error < 8.0
    run = runs[PRINTED_SIGNS]
    assert np.abs(error(run)[run.time < 1.0]).max() > 1e5


def test_random_drives(runs):
    """On 24 of the 200 drives of the study, for 10 s."""
    own, pid = errors_on_random_drives(runs, [NN[100.0], PID[100.0]], range(DRIVES))
    assert own[:, 0].max() < 20.0
    assert own[:, 1].max() < 60.0
    assert np.median(own[:, 0]) < 0.3 * np.median(pid[:, 0])
    assert len(set(own[:, 0])) == DRIVES


def test_all_random_drives_stay_bounded(runs):
    """All 200 drives for 10 s, alternately at the two frequencies; the study runs each drive at both."""
    drives = range(table_random_drives.DRIVES)
    found = np.concatenate(
        [
            errors_on_random_drives(runs, [SHIPPED[frequency]], drives[index :: len(FREQUENCIES)])[0]
            for index, frequency in enumerate(FREQUENCIES)
        ]
    )
    assert len(found) == 200
    assert found[:, 0].max() < 4.0
    assert found[:, 2].max() < BOUND


def test_the_errors_on_a_random_drive_are_those_of_a_run_of_its_own(runs):
    """Exactly, for the law of the thesis and for a PID, at their indices of the result."""
    cases = (NN[200.0], PID[100.0])
    found = errors_on_random_drives(runs, cases, [5, 3])
    for case, errors in zip(cases, found[:, 1], strict=True):
        parameters = runs.parameters(case)
        drive = random_drive(parameters['vcm_plant'], 3)
        rows = Experiment(1e-4, case.controller, {**parameters, 'vcm_plant': drive}).run(0, 100_001)
        signals = (rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0])
        expected = tracking_metrics(*signals, TRANSIENT, NANOMETRES)
        ever = NANOMETRES * np.abs(rows.head[:, 0] - rows.reference[:, 0]).max()
        assert errors.tolist() == [expected.rms_error, expected.max_error, ever]


def test_a_run_that_diverges_on_a_random_drive_has_no_error(runs, monkeypatch):
    def drawn(nominal, number):
        return {**nominal, 'gain': 1e300} if number == 1 else nominal

    monkeypatch.setattr(random_drives, 'random_drive', drawn)
    campaign = random_drives.campaign_on_drives(runs, [PID[100.0]], range(2))
    assert campaign.run()['verdict'].tolist() == ['tracks', 'diverged']
    ((bounded, diverged),) = errors_on_random_drives(runs, [PID[100.0]], range(2))
    assert np.isfinite(bounded).all()
    assert np.isnan(diverged).all()


def test_random_drives_of_runs_with_other_drives_are_rejected(runs, monkeypatch):
    cases = (NN[100.0], PID[100.0])
    other = {case.name: {'vcm_plant': {'gain': float(index)}} for index, case in enumerate(cases)}
    monkeypatch.setattr(type(runs), 'parameters', lambda self, case: other[case.name])
    with pytest.raises(ValueError, match=r'the drives of pid_100_hz and nn_100_hz differ'):
        errors_on_random_drives(runs, cases, range(2))


def test_a_drive_that_diverges_is_named(runs, monkeypatch, tmp_path):
    """Drive 1 of two, for four controllers and two frequencies, in the title and the last column of the table."""

    def errors(runs, cases, drives):
        return np.array([[(np.nan,) * 3 if drive == 1 else (1.0, 2.0, 3.0) for drive in drives] for _ in cases])

    monkeypatch.setattr(table_random_drives, 'DRIVES', 2)
    monkeypatch.setattr(table_random_drives, 'errors_on_random_drives', errors)
    text = table_random_drives.make(runs, tmp_path / 'table').read_text()
    assert text.count('| 1 of 2 |') == text.count('Hz on drive 1') == 8


def test_a_random_drive_is_drawn_within_its_range(runs):
    nominal = runs.parameters(NN[100.0])['vcm_plant']
    assert random_drive(nominal, 3) == random_drive(nominal, 3)
    ratios = []
    for seed in range(50):
        drive = random_drive(nominal, seed)
        assert drive['friction.static_level'] >= drive['friction.coulomb_level']
        ratios.append(drive['gain'] / nominal['gain'])
        for section in range(0, 12, 3):
            own, other = (
                (values['resonance.denominators'][section + 1], values['resonance.denominators'][section + 2])
                for values in (drive, nominal)
            )
            frequency = np.sqrt(own[1] / other[1])
            ratios += [frequency, own[0] / other[0] / frequency]
    assert 0.8 <= min(ratios) < 0.82
    assert 1.18 < max(ratios) <= 1.2


def test_no_case_sets_an_empty_list():
    """A ROS node does not accept an empty list, although simulate does."""
    assert not [
        case.name
        for figure in figures('chapter5').values()
        for case in figure.CASES
        if () in case.overrides.values() or [] in case.overrides.values()
    ]


def test_every_figure_and_table_is_made(directory, monkeypatch):
    monkeypatch.setattr(table_random_drives, 'DRIVES', 2)
    made = drawn()
    paths = make_figures(made, directory)
    assert {path.stem for path in paths} == set(made)
    for path in paths:
        assert path.suffix in ('.png', '.md')
        assert 100 < path.stat().st_size < 150_000, path
    hysteresis = (directory / 'figures' / 'table_hysteresis.md').read_text()
    assert all(f'| {name} | ' in hysteresis for name in (*HYSTERESIS, *HYSTERESIS_PID))
