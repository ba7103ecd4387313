"""Each check of the track error passes at the value that the error was given, and fails below."""

import functools

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.testing.checks import CheckFailed

T = 1e-4
COUNT = 2001
SECTORS = 100
TIME = T * np.arange(COUNT)


@pytest.fixture
def moved(simulated, tmp_path):
    """Return a function that makes a run whose track error is given [um]."""
    source = simulated(tmp_path / 'run', '-p', 'duration:=0.2', '-p', 'controller:=pid')

    def make(error):
        run = Run.open(source)
        assert len(run.ticks) == COUNT
        run.__dict__['track_error'] = error
        return run

    return make


def holds_at(check, value, unit_text=''):
    """Assert that a check holds just above its value and fails just below, with a plot."""
    check(at_most=1.0001 * value + 1e-12)
    with pytest.raises(CheckFailed, match=r'plot: .+\.png') as caught:
        check(at_most=0.9999 * value)
    assert unit_text in str(caught.value)


def test_errors(moved):
    error = np.random.default_rng(1).normal(scale=0.01, size=COUNT)
    run = moved(error)
    holds_at(run.check.track_error, 3e3 * np.std(error, ddof=1), 'track error, 3 sigma, is')
    holds_at(functools.partial(run.check.peak_track_error, after=0.1), 1e3 * np.abs(error[1000:]).max(), ' nm')
    holds_at(functools.partial(run.check.bounded, 'track_error'), 1e3 * np.abs(error).max())


def test_runout(moved):
    noise = np.random.default_rng(2).normal(scale=0.004, size=COUNT)
    run = moved(0.03 * np.sin(2.0 * np.pi * np.arange(COUNT) / SECTORS) + noise)
    folded = 1e3 * run.track_error[1:].reshape(-1, SECTORS)
    mean = folded.mean(axis=0)
    holds_at(functools.partial(run.check.rpe, sectors=SECTORS), np.ptp(mean), 'RPE')
    sigma = np.sqrt(np.sum((folded - mean) ** 2) / (SECTORS * (len(folded) - 1)))
    holds_at(functools.partial(run.check.nrpe, sectors=SECTORS), 3.0 * sigma, 'NRPE')
    with pytest.raises(ValueError, match='no spindle of disturbance_generator; give sectors='):
        run.check.nrpe(at_most=1.0)
    with pytest.raises(ValueError, match='two complete revolutions'):
        run.check.nrpe(at_most=1.0, after=0.19, sectors=SECTORS)


def test_off_track(moved):
    error = np.zeros(COUNT)
    error[100:140], error[500:510] = 0.12, -0.2
    run = moved(error)
    holds_at(run.check.time_off_track, 50 / COUNT)
    holds_at(functools.partial(run.check.time_off_track, beyond=0.15), 10 / COUNT)
    holds_at(run.check.longest_off_track, 40 * T, ' s')


def test_shocks(moved):
    error = np.where(TIME > 0.05, 0.4 * np.exp(-np.maximum(TIME - 0.05, 0.0) / 0.01), 0.0)
    run = moved(error)
    # Within 100 nm after 0.01 ln 4.
    holds_at(functools.partial(run.check.shock_recovery, band=100.0, shocks=[0.05]), 0.0139, ' s')
    holds_at(functools.partial(run.check.shock_outside, band=100.0, shocks=[0.05]), 0.0138)
    holds_at(functools.partial(run.check.shock_peak, shocks=[0.05]), 400.0 * np.exp(-0.01), ' nm')
    with pytest.raises(ValueError, match='no shock on /base_acceleration; give shocks='):
        run.check.shock_peak(at_most=1.0)
    with pytest.raises(CheckFailed, match='time to recover from a shock is inf s'):
        run.check.shock_recovery(at_most=1.0, band=1e-6, shocks=[0.05])


def test_without_a_disturbance_there_is_no_least_error(moved):
    with pytest.raises(ValueError, match='unknown lower bound of the error: the run has no /disturbance'):
        moved(np.zeros(COUNT)).check.error_over_least(at_most=2.0)
