"""Saturation as a bag tells of it, against the blocks' own counts."""

from hdd_servo_ros.parameters import to_mapping
from hdd_servo_ros.reporting.saturation import saturated_rows
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.simulation.experiment import Experiment

T = 1e-4


def run_of(ldv, output):
    """Return signals and run.yaml of half a second under the PID controller, and the experiment."""
    sections = {'ldv_sensor': ldv, 'pid_controller': output}
    experiment = Experiment(T, 'pid', sections)
    signals = experiment.run(0, 5000)
    nodes = {
        '/bench/ldv_sensor': {'parameters': {**to_mapping(experiment.ldv.parameters), 'sample_time': 0.0}},
        '/bench/pid_controller': {'parameters': to_mapping(experiment.dsp.parameters, 'dsp.')},
    }
    return signals, {'nodes': nodes, 'sample_time': T}, experiment


def test_nothing_saturates_by_default():
    signals, run, _ = run_of({}, {})
    assert saturated_rows(signals, run) == {}
    assert 'saturation' not in summary(signals, run)


def test_counts_and_first_ticks_are_those_of_the_blocks():
    signals, run, experiment = run_of({'output_range': 0.23}, {'dsp.dac_bits': 10, 'dsp.dac_range': 0.09})
    found = saturated_rows(signals, run)
    assert set(found) == {'displacement output', 'velocity output', 'control'}
    for output, count in experiment.ldv.saturated_samples.items():
        ticks = found[f'{output} output']
        # Values that only round to the last code lie at the end as well.
        assert count <= len(ticks) < 1.05 * count
        assert ticks[0] == experiment.ldv.first_saturated_tick[output]
    # A command less than a step beyond the limit is not told from a rounded one.
    assert 0.8 * experiment.dsp.saturated_samples < len(found['control']) <= experiment.dsp.saturated_samples
    assert f'control {len(found["control"])} of 5000 samples' in summary(signals, run)


def test_a_run_without_such_nodes():
    signals, _, _ = run_of({}, {})
    assert saturated_rows(signals, {}) == {}
    assert saturated_rows(signals, {'nodes': {'/ordinary': {'parameters': {}}}}) == {}


def test_fractions_of_a_track_that_the_servo_sensor_clips():
    sections: dict[str, dict[str, object]] = {
        'servo_sensor': {'track_pitch': 0.05, 'noise': 0.01, 'bits': 8},
        'reference_generator': {'waveform': 'constant', 'amplitude': 0.0},
    }
    experiment = Experiment(T, 'pid', sections, sensor='servo')
    signals = experiment.run(0, 5000)
    assert experiment.servo is not None
    nodes = {'/servo_sensor': {'parameters': to_mapping(experiment.servo.parameters)}}
    found = saturated_rows(signals, {'nodes': nodes, 'sample_time': T})
    count = experiment.servo.saturated_samples['fraction']
    assert count > 10
    # A fraction that only rounds to the last code lies at the end as well.
    assert count <= len(found['fraction of a track']) < 2 * count
    assert 'fraction of a track' in summary(signals, {'nodes': nodes, 'sample_time': T})
