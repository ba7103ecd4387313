"""The swept sine through the graph: same bits everywhere, the CSV from the bag, and what identification finds in it."""

import signal
from pathlib import Path

import numpy as np
import pytest

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.identification import identify_measured
from hdd_servo_ros.analysis.rational_fit import LEVY
from hdd_servo_ros.bench.response import read_csv
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.reporting.recorded_response import response_of_run
from hdd_servo_ros.studies.swept_sine import FROM, true_modes, with_noise

SWEPT_SINE = Path(__file__).parents[2] / 'params' / 'swept_sine.yaml'
OVERLAY = ('--params-file', str(SWEPT_SINE))
SWEEP = (*OVERLAY, '-p', 'controller:=signal_analyzer')
SHORT = (
    '-p',
    'start_frequency:=5000.0',
    '-p',
    'points_per_decade:=[10]',
    '-p',
    'settle_time:=0.002',
    '-p',
    'integrate_time:=0.002',
)


def deviations(model):
    """Relative deviations of the gain, and the largest of the modes' frequencies and dampings."""
    true = np.array(true_modes(PlantParameters()))
    modes = [mode for mode in model.modes() if mode.pole.imag > 0.0][-4:]
    found = np.array([(mode.frequency, mode.damping) for mode in modes])
    gain = abs(model.rigid_gain() / PlantParameters().rigid_gain - 1.0)
    return np.array([gain, *np.abs(found / true - 1.0).max(axis=0)])


def test_a_sweep_to_20_khz_is_identified_within_the_limits(bench):
    """Gain within 0.5 %, the four modes within 0.1 %, their dampings within 2.5 %; with 1 % of noise on top as well."""
    process = bench.start(
        'simulate', *SWEEP, '-p', f'start_frequency:={FROM}', '-p', 'run_dir:=sweep', '-p', 'plot:=true'
    )
    assert process.wait(600.0) == 0, process.output
    directory = bench.directory / 'sweep'
    measured = read_csv(directory / 'response.csv')
    assert (directory / 'response.png').stat().st_size > 10_000
    assert measured.frequency[0] == pytest.approx(FROM, rel=0.01)
    assert measured.frequency[-1] == pytest.approx(20_000.0, rel=0.01)

    from_bag = response_of_run(Run.open(directory))
    from_bag.write_csv(bench.directory / 'from_bag.csv')
    assert (bench.directory / 'from_bag.csv').read_bytes() == (directory / 'response.csv').read_bytes()

    limits = np.array([0.005, 0.001, 0.025])
    assert np.all(deviations(identify_measured(measured, 10, 4)) <= 0.1 * limits)
    noisy = [deviations(identify_measured(with_noise(measured, 0.01, seed), 10, 4)) for seed in range(10)]
    assert np.all(noisy[0] <= limits)
    assert sum(bool(np.all(found <= limits)) for found in noisy) >= 9
    assert deviations(identify_measured(with_noise(measured, 0.01, 0), 10, 4, method=LEVY))[1] > 0.05

    command = bench.python('-m', 'hdd_servo_ros.studies.swept_sine', str(directory), '--noise', '0.01')
    assert command.returncode == 0, command.stderr
    assert '| mode 4 [Hz] | 14572.0 |' in command.stdout


def test_rig_separate_processes_and_simulate_measure_the_same(bench):
    bench.run('rig', *SWEEP, *SHORT, '-p', 'run_dir:=rig')
    bench.run('simulate', *SWEEP, *SHORT, '-p', 'run_dir:=simulated')
    nodes = ('bag_recorder', 'signal_analyzer', 'ldv_sensor', 'vcm_plant', 'reference_generator', 'deterministic_timer')
    # The recorder names the folder, and the analyzer finds it.
    processes = [bench.start(node, *OVERLAY, *SHORT) for node in nodes]
    for process in processes:
        assert process.wait() == 0, process.output
    (apart,) = (bench.directory / 'runs').iterdir()
    simulated = bench.directory / 'simulated'
    expected = (simulated / 'response.csv').read_bytes()
    assert len(expected.splitlines()) == 8
    for other in (bench.directory / 'rig', apart):
        assert first_difference(simulated, other) is None
        assert (other / 'response.csv').read_bytes() == expected
    run = bench.run_yaml('rig')
    assert run['duration'] == pytest.approx(run['last_tick'] * 2e-5)
    assert run['nodes']['/signal_analyzer']['last_tick_needed'] == run['last_tick']


@pytest.mark.parametrize('executable', ['rig', 'simulate'])
@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((*SWEEP, '-p', 'duration:=0.5'), 'deterministic_timer:duration: 0.5; expected 0 (as long as'),
        ((*SWEEP, '-p', 'deterministic_timer:sample_time:=1e-4'), 'stop_frequency: 20000.0; expected at most 4500'),
        ((*OVERLAY, '-p', 'controller:=pid'), 'deterministic_timer:duration: 0.0; expected above 0 s'),
    ],
)
def test_a_length_or_a_frequency_that_does_not_fit_is_rejected(bench, executable, arguments, message):
    process = bench.start(executable, *arguments)
    assert process.wait() == 2, process.output
    assert message in process.output


def test_apart_a_duration_that_is_too_short_ends_all(bench):
    nodes = ('bag_recorder', 'signal_analyzer', 'ldv_sensor', 'vcm_plant', 'reference_generator', 'deterministic_timer')
    processes = [bench.start(node, *OVERLAY, *SHORT, '-p', 'duration:=0.01') for node in nodes]
    for process in processes:
        assert process.wait() == 1
        assert 'duration: 0.01; expected 0 (as long as /signal_analyzer needs)' in process.output


@pytest.mark.parametrize('executable', ['rig', 'simulate'])
def test_too_much_excitation_fails_with_what_was_measured_before_it(bench, executable):
    """Ten volts at 150 Hz drive the head out of the vibrometer's range, after a range that they do not."""
    process = bench.start(
        executable,
        *SWEEP,
        *SHORT,
        *('-p', 'start_frequency:=100.0', '-p', 'stop_frequency:=200.0', '-p', 'range_limits:=[120.0]'),
        *('-p', 'amplitudes:=[0.05, 10.0]', '-p', 'level_reductions:=1', '-p', 'run_dir:=failed'),
    )
    assert process.wait() == 1, process.output
    assert 'after 1 halvings: displacement output' in process.output
    assert 'parameter overload_level = 9.5 V' in process.output
    run = bench.run_yaml('failed')
    assert run['status'] == 'failed'
    assert 'lower amplitudes' in run['reason']
    assert len(read_csv(bench.directory / 'failed' / 'response.csv').frequency) == 1


def test_a_sweep_that_is_interrupted_keeps_what_it_has(bench):
    slow = ('-p', 'deterministic_timer:rate:=0.2')
    process = bench.start('rig', *SWEEP, *slow, '-p', 'start_frequency:=1000.0', '-p', 'run_dir:=stopped')
    process.wait_for('s left')  # after the first seconds, of a run of twenty
    process.signal(signal.SIGINT)
    assert process.wait() == 130, process.output
    assert bench.run_yaml('stopped')['status'] == 'interrupted'
    assert 1 <= len(read_csv(bench.directory / 'stopped' / 'response.csv').frequency) < 80
