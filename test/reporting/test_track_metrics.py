"""The metrics of the track in a report: against the disturbance that the test made, and what is left out without it."""

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.reporting import run_bound, track_metrics, track_panels
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.reporting.track_of_run import track_pitch
from hdd_servo_ros.testing.checks import CheckFailed
from hdd_servo_ros.tools.report import main

from .shaken import SECTORS, shaken_run

TICKS = 400 * SECTORS


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    return shaken_run(tmp_path_factory.mktemp('shaken') / 'run', TICKS)


def metrics(run):
    return {metric.name: metric.value for metric in run_metrics(run)}


def test_rpe_is_the_runout_and_nrpe_the_rest(run):
    found = metrics(run)
    error = 1e3 * (run.position - run.desired_position - run.disturbance[:, 1])[run.since(0.5 * run.duration)]
    assert found['track_error'] == pytest.approx(3.0 * np.std(error), rel=1e-3)
    assert found['peak_track_error'] == pytest.approx(np.abs(error).max())
    assert found['rpe'] == pytest.approx(60.0, rel=0.2)
    # 30 nm of runout are 63.6 nm of 3 sigma.
    assert found['nrpe'] == pytest.approx(np.sqrt(found['track_error'] ** 2 - 63.6**2), rel=0.03)
    assert found['nrpe_of_pitch'] == pytest.approx(0.1 * found['nrpe'] / 1.016)


def test_the_vibration_gives_the_error_of_the_issue(tmp_path):
    """75 +- 8 nm without feedforward at T = 0.1 ms; here without runout and flutter at nearly the same T."""
    found = metrics(shaken_run(tmp_path / 'run', TICKS, runout=0.0, flutter=0.0))
    assert found['track_error'] == pytest.approx(75.0, abs=8.0)
    assert found['track_error_of_pitch'] == pytest.approx(7.4, abs=0.8)


def test_time_off_track_is_a_share_of_samples(run):
    found = metrics(run)
    error = np.abs(run.track_error[run.since(0.5 * run.duration)])
    for percent in (10, 15):
        share = 100.0 * np.mean(error > 0.01 * percent * 1.016)
        assert found[f'off_track_{percent}'] == pytest.approx(share)
    assert found['off_track_10'] > 0.0
    assert found['longest_off_track_10'] > 0.0


def test_the_least_error_is_below_that_of_the_run(run):
    found = metrics(run)
    # The flutter is not measured by a vibrometer: 12 nm stay.
    assert 12.0 < found['least_error'] < 25.0
    assert found['error_over_least'] == pytest.approx(found['nrpe'] / found['least_error'], rel=0.01)
    ratio = found['error_over_least']
    after = float(run.time[run.since(0.5 * run.duration)][0])
    run.check.error_over_least(at_most=1.001 * ratio, after=after)
    with pytest.raises(CheckFailed, match='track error over its lower bound is'):
        run.check.error_over_least(at_most=0.999 * ratio, after=after)
    run.check.nrpe(at_most=found['nrpe'] + 0.01, after=after).rpe(at_most=found['rpe'] + 0.01, after=after)
    assert found['bode_theory'] == pytest.approx(0.0, abs=1e-6)
    assert found['bode_integral'] == pytest.approx(0.0, abs=1e-3)


def test_shocks_are_measured_and_drawn(run, monkeypatch):
    """The times at which the base begins to move are given; the error is the recorded one."""
    times = np.array([1.0, 2.0])
    for module in (track_metrics, track_panels, run_bound):
        monkeypatch.setattr(module, 'shocks_of', lambda _: times)
    found = metrics(run)
    error = 1e3 * np.abs(run.track_error[run.since(1.0)])
    assert found['shocks'] == 2
    assert found['shock_peak'] == pytest.approx(error.max())
    assert found['shock_outside'] > 0.0
    assert 'no lower bound of the error: shocks have no stationary spectrum' in left_out(run)
    (panel,) = (panel for panel in track_panels.track_panels(run, 0) if panel.name == 'shocks')
    assert [trace.name for trace in panel.traces] == ['shock at 1 s', 'shock at 2 s']
    np.testing.assert_allclose(panel.traces[1].x[[0, -1]], [-1.0, 15.0], atol=0.1)
    at_shock = np.abs(panel.traces[1].x).argmin()
    row = run.since(2.0).start
    assert panel.traces[1].y[at_shock] in 1e3 * run.track_error[row - 1 : row + 1]


def test_another_pitch(tmp_path):
    run = shaken_run(tmp_path / 'run', 20 * SECTORS, pitch=0.254)
    found = metrics(run)
    assert track_pitch(run) == 0.254
    assert found['track_error_of_pitch'] == pytest.approx(found['track_error'] / 2.54)
    assert any(line.startswith('no lower bound of the error: 0.08') for line in left_out(run))
    assert 'least_error' not in found


@pytest.mark.parametrize(
    ('sectors', 'reason'),
    [(0, 'spindle.sectors = 0'), (100, 'sectors = 100 with sample_time = 8.3333e-05 s at 7200 1/min')],
)
def test_without_whole_revolutions_there_is_no_rpe(tmp_path, sectors, reason):
    run = shaken_run(tmp_path / 'run', 10 * SECTORS, sectors=sectors)
    assert 'rpe' not in metrics(run)
    assert any(line.startswith('no RPE and NRPE: ') and reason in line for line in left_out(run))


def test_a_run_without_force_has_no_bound(tmp_path):
    run = shaken_run(tmp_path / 'run', TICKS, vibration=0.0, runout=0.0, flutter=0.0)
    assert 'no lower bound of the error: /disturbance is 0' in left_out(run)


def test_the_report_shows_the_track(run, tmp_path, capsys):
    panels = {panel.name: panel for panel in run_panels(run)}
    assert [name for name in panels if name in ('track_error', 'cumulative_spectrum', 'runout')] == [
        'track_error',
        'cumulative_spectrum',
        'runout',
    ]
    rpe = panels['runout'].traces[0]
    expected = -30.0 * np.sin(2.0 * np.pi * np.arange(SECTORS) / SECTORS)
    # What vibration leaves in the mean of 200 revolutions.
    np.testing.assert_allclose(rpe.y, expected, atol=12.0)
    whole, without = panels['cumulative_spectrum'].traces
    found = metrics(run)
    assert 3.0 * whole.y[-1] == pytest.approx(found['track_error'], rel=0.03)
    assert 3.0 * without.y[-1] == pytest.approx(found['nrpe'], rel=0.03)
    assert main([str(run.path), '--output', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'NRPE, 3 sigma, of track pitch [%]' in printed
    content = yaml.safe_load((tmp_path / 'metrics.yaml').read_text())
    assert content['metrics']['nrpe']['unit'] == 'nm'
    assert 'Cumulative spectrum of the track error' in (tmp_path / 'report.html').read_text()


def test_a_run_without_a_disturbance_is_as_before(simulated, tmp_path):
    run = Run.open(simulated(tmp_path / 'run', '-p', 'duration:=0.05'))
    assert np.array_equal(run.track_error, run.error)
    assert 'track_error' not in metrics(run)
    assert not any('RPE' in line for line in left_out(run))
    assert run.parameter('vcm_plant', 'track_pitch') == 1.016
