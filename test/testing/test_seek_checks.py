"""Each check of the seeks passes at the value that the run has, and fails below, with a plot and the seek."""

import functools

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.seek_bounds import time_optimal_seek
from hdd_servo_ros.analysis.seek_metrics import Seek, seek_responses
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.testing.checks import CheckFailed

T = 1e-4
TARGETS = (1.0, 11.0, 11.5)
SCALES = ('-p', 'ldv_sensor:velocity_scale:=100000.0')


@pytest.fixture(scope='module')
def source(simulated, tmp_path_factory):
    """Seeks of 1, 10 and 0.5 um, 20 ms apart, by a PID controller along trajectories."""
    arguments = ('waveform:=seek', f'seek.targets:={list(TARGETS)}', 'seek.dwell_times:=[0.02]', 'seek.repeat:=false')
    given = (part for text in ('controller:=pid', 'duration:=0.06', *arguments) for part in ('-p', text))
    return simulated(tmp_path_factory.mktemp('seeking') / 'run', *given, *SCALES)


@pytest.fixture
def run(source, tmp_path, monkeypatch):
    monkeypatch.setattr('hdd_servo_ros.testing.checks.plot_directory', tmp_path)
    return Run.open(source)


def responses(run, tolerance, **options):
    """Return the responses, with seeks that were written down by hand."""
    origins = (0.0, *TARGETS)
    seeks = [Seek(200 * index, origins[index], target) for index, target in enumerate(TARGETS)]
    return seek_responses(seeks, run.position, run.head.velocity, run.command, T, tolerance, **options)


def holds_at(check, value, *texts):
    """Assert that a check holds just above its value and fails just below, with a plot."""
    assert np.isfinite(value)
    check(at_most=1.0001 * value + 1e-12)
    with pytest.raises(CheckFailed, match=r'plot: .+\.png') as caught:
        check(at_most=0.9999 * value)
    for text in texts:
        assert text in str(caught.value)


def test_seek_times(run):
    times = [response.seek_time for response in responses(run, 0.1016)]
    assert times[1] > max(times[0], times[2])
    holds_at(run.check.seek_time, times[1], 'for the seek of +10 um at tick 200 (0.02 s)', '1 of 3 seeks are above')
    short = functools.partial(run.check.seek_time, shortest=1.0, longest=1.0)
    holds_at(short, times[0], 'for the seek of +1 um at tick 0')
    tight = functools.partial(run.check.seek_time, tolerance=25.0, longest=1.0)
    holds_at(tight, max(response.seek_time for response in responses(run, 0.025) if abs(response.seek.length) <= 1.0))
    early = functools.partial(run.check.seek_time, samples=1, stay=0.0)
    holds_at(early, max(response.seek_time for response in responses(run, 0.1016, samples=1, stay=0.0)))


def test_measured_seek_times(run):
    """Of a position with 3 nm of noise."""
    measured = 8.0 * run.ldv.displacement
    assert np.std(measured - run.position) == pytest.approx(3e-3, rel=0.1)
    origins = (0.0, *TARGETS)
    seeks = [Seek(200 * index, origins[index], target) for index, target in enumerate(TARGETS)]
    slowest = []
    for position in (measured, run.position):
        found = seek_responses(seeks, position, run.head.velocity, run.command, T, 0.006, samples=4, stay=0.0)
        slowest.append(max(response.seek_time for response in found))
    assert slowest[0] != slowest[1]
    check = functools.partial(run.check.seek_time, tolerance=6.0, samples=4, stay=0.0)
    holds_at(functools.partial(check, measured=True), slowest[0], 'measured seek time is')
    holds_at(check, slowest[1])


def test_how_the_head_arrives(run):
    found = responses(run, 0.1016)
    holds_at(run.check.seek_overshoot, 1e3 * max(response.overshoot for response in found), 'overshoot', ' nm')
    holds_at(run.check.residual_vibration, 1e3 * max(response.residual_rms for response in found), 'residual vibration')
    ratios = [
        response.seek_time / time_optimal_seek(PlantParameters(), response.seek.length).time for response in found
    ]
    holds_at(run.check.seek_time_over_optimal, max(ratios), 'seek time over T*')


def test_a_seek_that_does_not_arrive_passes_no_check(run):
    head = np.array(Run.open(run.path).head)
    # It comes within the tolerance, and leaves it before the next seek.
    head[397:400, 0] += 0.5
    run._arrays['head'] = head
    for check in (run.check.seek_time, run.check.residual_vibration, run.check.seek_time_over_optimal):
        with pytest.raises(CheckFailed, match=r'does not arrive within 101\.6 nm, and leaves the tolerance again'):
            check(at_most=1e6)
        check(at_most=1e6, longest=1.0)


def test_what_cannot_be_checked(run, simulated, tmp_path):
    with pytest.raises(ValueError, match='no seek from 20 to inf um'):
        run.check.seek_time(at_most=1.0, shortest=20.0)
    with pytest.raises(ValueError, match='invalid limit'):
        run.check.seek_time(at_most=np.nan)
    with pytest.raises(ValueError, match='invalid tolerance of a seek'):
        run.check.seek_time(at_most=1.0, tolerance=0.0)
    with pytest.raises(ValueError, match='no estimate seek_mode'):
        run.check.no_return_to_an_earlier_mode()
    sine = Run.open(simulated(tmp_path / 'sine', '-p', 'controller:=pid', '-p', 'duration:=0.05'))
    for check in (sine.check.seek_time, sine.check.seek_overshoot, sine.check.residual_vibration):
        with pytest.raises(ValueError, match='the run has no seeks'):
            check(at_most=1.0)


def with_modes(run, modes):
    """Return the run with an estimate ``seek_mode``."""
    run.__dict__['estimate_names'] = ('t', 'seek_mode')
    run._arrays['estimates'] = np.column_stack([run.time, modes])
    return run


def test_no_return_to_an_earlier_mode(run):
    modes = np.zeros(len(run.ticks))
    for start in (0, 200, 400):
        modes[start : start + 10], modes[start + 10 : start + 25] = 1.0, 2.0
    with_modes(run, modes).check.no_return_to_an_earlier_mode()


def test_a_return_to_an_earlier_mode(run):
    modes = np.zeros(len(run.ticks))
    modes[200:210], modes[210:220], modes[250:255] = 1.0, 2.0, 2.0
    with pytest.raises(CheckFailed, match=r'from follow to settle, .* is at tick 250 \(0.025 s\)[\s\S]+plot: .+\.png'):
        with_modes(run, modes).check.no_return_to_an_earlier_mode()
