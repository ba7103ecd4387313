"""Runs with the servo sensor: their errors are relative to the track, and the bound is that of their sensor."""

import re
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.feedback_responses import MeasuredDrive
from hdd_servo_ros.analysis.least_error import DisturbanceSpectra, least_error, white_density
from hdd_servo_ros.analysis.sampled_drive import sampled_drive
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.reporting.comparison_panels import comparison_panels
from hdd_servo_ros.reporting.loop_panels import loop_panels
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.reporting.track_of_run import track_pitch
from hdd_servo_ros.testing.checks import CheckFailed

PARAMS = Path(__file__).parents[2] / 'params'
NSS = [PARAMS / 'nss_100ktpi.yaml', PARAMS / 'nss_100ktpi_10_khz.yaml']
FILES = [argument for file in NSS for argument in ('--params-file', str(file))]
T = 9.9206e-5


@pytest.fixture(scope='module')
def run(tmp_path_factory, simulated):
    directory = tmp_path_factory.mktemp('servo') / 'run'
    return Run.open(simulated(directory, *FILES, '-p', f'duration:={24_000 * T!r}'))


def metrics(run):
    return {metric.name: metric.value for metric in run_metrics(run)}


def test_every_error_is_relative_to_the_track(run):
    expected = 1e3 * (run.position - run.desired_position - run.disturbance.track_center)
    np.testing.assert_allclose(1e3 * run.position_error, expected, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(run.error, run.position - run.desired_position)
    late = expected[run.since(0.5 * run.duration)]
    found = metrics(run)
    assert found['rms_error'] == pytest.approx(np.sqrt(np.mean(late**2)), rel=1e-9)
    assert found['max_error'] == pytest.approx(np.abs(late).max(), rel=1e-9)
    assert found['tmr'] == pytest.approx(found['track_error'], rel=1e-9)
    assert 'edges' not in found, 'the first displacement of the track is not an edge of the reference'
    rms = re.search(r'^ +track error  ([\d.]+) nm rms, ([\d.]+) nm max', summary(run, run.description), re.MULTILINE)
    assert rms is not None
    # The summary counts from half of the run on, as the report does.
    assert float(rms[1]) == pytest.approx(found['rms_error'], rel=1e-3)
    assert float(rms[2]) == pytest.approx(found['max_error'], rel=1e-3)
    run.check.rms_error(at_most=found['rms_error'] * 1.001, after=0.5 * run.duration)
    with pytest.raises(CheckFailed, match='rms error is'):
        run.check.rms_error(at_most=found['rms_error'] * 0.999, after=0.5 * run.duration)


def test_pictures_name_the_error_that_they_show(run):
    (error,) = (panel for panel in loop_panels(run, follows=True) if panel.name == 'error')
    assert error.title == 'Track error, x - x_d - track center'
    assert error.traces[0].name == 'head - reference - track center'
    assert np.abs(error.traces[0].y).max() == pytest.approx(1e3 * np.abs(run.track_error).max())
    names = [panel.name for panel in run_panels(run)]
    assert 'track_error' in names
    assert 'error' not in names, 'it would be the same diagram twice'
    (error, *_) = comparison_panels([run, run])
    assert error.title == 'Track error, x - x_d - track center'


def test_with_the_vibrometer_the_error_stays_that_of_the_reference(tmp_path, simulated, run):
    arguments = ('-p', 'sensor:=ldv', '-p', 'disturbance_generator:flutter.enabled:=true', '-p', 'duration:=0.05')
    ldv = Run.open(simulated(tmp_path / 'run', '-p', 'controller:=pid', *arguments))
    np.testing.assert_array_equal(ldv.position_error, ldv.position - ldv.desired_position)
    assert not np.array_equal(ldv.position_error, ldv.track_error)
    assert {'error', 'track_error'} <= {panel.name for panel in run_panels(ldv)}
    (error, *_) = comparison_panels([run, ldv])
    assert error.title == 'Position error, x - x_d, with the servo sensor minus the track center'


def test_shares_are_of_the_pitch_of_the_servo_sensor(run):
    assert track_pitch(run) == 0.254
    found = metrics(run)
    assert found['nrpe_of_pitch'] == pytest.approx(0.1 * found['nrpe'] / 0.254)


def test_an_unrecorded_disturbance_is_named(tmp_path, simulated):
    topics = "['reference', 'head', 'pes', 'control']"
    recorded = ('-p', f'duration:={500 * T!r}', '-p', f'bag_recorder:topics:={topics}')
    part = Run.open(simulated(tmp_path / 'run', *FILES, *recorded))
    np.testing.assert_array_equal(part.position_error, part.position - part.desired_position)
    assert any('the errors are x - x_d' in line for line in left_out(part))


def flutter_density(lines):
    """Return the density of the sampled flutter: white noise through w^2/(s^2 + 2 z w s + w^2), aliased [um^2/Hz]."""
    own = read_parameter_files(NSS)['disturbance_generator']
    modes = zip(*(own[f'flutter.{name}'] for name in ('frequencies', 'damping_ratios', 'sigmas')), strict=True)
    density = np.zeros_like(lines)
    for frequency, damping, sigma in modes:
        w = 2.0 * np.pi * frequency
        # The last modes are near half the sampling frequency.
        for s in (2j * np.pi * lines, 2j * np.pi * (1.0 / T - lines)):
            shape = np.abs(1.0 / (s**2 + 2.0 * damping * w * s + w**2)) ** 2
            # The integral of |1/(...)|^2 over all frequencies from 0 on is 1/(8 z w^3).
            density += sigma**2 * 8.0 * damping * w**3 * shape
    return density


def test_the_bound_is_that_of_the_spectra_that_the_parameters_state(run):
    lines = np.linspace(0.0, 0.5 / T, 40_001)
    track = flutter_density(lines)
    step = lines[1]
    assert 3e3 * np.sqrt(track.sum() * step) == pytest.approx(13.2, rel=0.05)
    force = np.full_like(lines, white_density(2.44e-3, 1.0 / 26_400.0))
    noise = white_density(np.hypot(3.81e-3, 0.254 / 2**12 / np.sqrt(12.0)), T)
    drive = MeasuredDrive.of(sampled_drive(PlantParameters(), T, presliding=True), 0)
    expected = least_error(drive, DisturbanceSpectra(lines, force, track, (noise,)), 2.0)
    found = metrics(run)
    # A second of noise, and lines of 10 Hz where modes are as narrow.
    assert found['least_error'] == pytest.approx(1e3 * expected.three_sigma, rel=0.08)
    assert found['error_over_least'] == pytest.approx(found['nrpe'] / found['least_error'], rel=0.02)
    assert 1.0 < found['error_over_least'] < 1.5
