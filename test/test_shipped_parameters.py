"""The shipped parameter files: every key is known, and the numbers do what they are shipped for."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdd_servo_ros.analysis.metrics import step_response, tracking_metrics
from hdd_servo_ros.graph.catalog import parameter_sets
from hdd_servo_ros.parameters import from_mapping, to_mapping
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.experiment import Experiment

PARAMS = Path(__file__).parents[1] / 'params'


@pytest.mark.parametrize('file', sorted(PARAMS.glob('*.yaml')), ids=lambda file: file.stem)
def test_every_key_of_the_shipped_files_is_known(file):
    for node, values in read_parameter_files([file]).items():
        kinds = parameter_sets(node)
        names = [set(to_mapping(kind())) for kind in kinds]
        for name in values:
            assert any(name in known for known in names), f'{node}: {name}'
        for kind, known in zip(kinds, names, strict=True):
            from_mapping(kind, {name: value for name, value in values.items() if name in known})


def test_every_shipped_file_is_in_the_reference():
    page = (PARAMS.parent / 'docs' / 'reference' / 'drives.md').read_text('utf8')
    assert [file.name for file in PARAMS.glob('*.yaml') if f'`{file.name}`' not in page] == []


def test_the_drive_of_chapter_5_is_the_default():
    for node, values in read_parameter_files([PARAMS / 'seagate_7200_10.yaml']).items():
        for kind in parameter_sets(node):
            default = to_mapping(kind())
            given = {name: value for name, value in values.items() if name in default}
            assert to_mapping(from_mapping(kind, given)) == default


def test_section_4_4():
    """The ranges that an independent implementation found for section 4.4: rms and largest error of the last half."""
    sections = read_parameter_files([PARAMS / 'simulation_study.yaml'])
    rows = Experiment(1e-4, 'adaptive_nn', sections).run(0, 200001)
    found = tracking_metrics(
        rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient=10.0, unit=1.0
    )
    assert 0.0027 < found.rms_error < 0.0041
    assert 0.0055 < found.max_error < 0.0083
    assert abs(rows.estimates['m_hat'][100000:].mean() - 1.0) < 0.05
    pid = Experiment(1e-4, 'pid', sections).run(0, 200001)
    compared = tracking_metrics(pid.time, pid.reference[:, 0], pid.head[:, 0], pid.control[:, 0], 10.0, 1.0)
    assert compared.peak_control <= 1.001 * found.peak_control
    assert compared.rms_error > 20.0 * found.rms_error


@pytest.mark.parametrize(
    ('files', 'sample_time', 'ticks'),
    [(('seagate_7200_10', 'thesis_law'), 1e-4, 10001), (('simulation_study',), 1e-3, 20001)],
)
def test_the_shipped_bounds_hold_what_the_estimates_pass(files, sample_time, ticks):
    """With projection the runs of both chapters stay what they are, and a bound that is too near changes them."""
    sections = read_parameter_files([PARAMS / f'{file}.yaml' for file in files])
    nn: dict[str, Any] = {**sections['adaptive_nn_controller'], 'projection': True}
    near = 0.05 * nn['mass.maximum']
    without, with_bounds, with_near_bounds = (
        Experiment(sample_time, 'adaptive_nn', {**sections, 'adaptive_nn_controller': own}).run(0, ticks)['estimates']
        for own in (sections['adaptive_nn_controller'], nn, {**nn, 'mass.minimum': -near, 'mass.maximum': near})
    )
    assert (with_bounds == without).all()
    assert (with_near_bounds != without).any()


def overlaid(*names):
    return read_parameter_files([PARAMS / f'{name}.yaml' for name in ('seagate_7200_10', *names)])


def run(sections, reference, seconds, controller='adaptive_nn'):
    experiment = Experiment(1e-4, controller, {**sections, 'reference_generator': reference})
    return experiment.run(0, round(seconds * 1e4) + 1)


def tracked(sections, frequency, seconds, amplitude=2.0, controller='adaptive_nn', transient=None):
    rows = run(sections, {'amplitude': amplitude, 'frequency': frequency}, seconds, controller)
    start = seconds - 1.0 if transient is None else transient
    return tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], start)


# Errors of a 2 um sine [nm], and of the best PID controller without a limit of the overshoot.
SINES = {10.0: 1.6, 20.0: 1.6, 30.0: 1.6, 50.0: 1.6, 60.0: 1.6, 100.0: 1.6, 200.0: 1.5, 500.0: 11.0}


@pytest.mark.parametrize('frequency', SINES)
def test_one_set_of_gains_from_10_to_500_hz(frequency):
    assert tracked(overlaid(), frequency, 4.0, transient=2.0).rms_error < SINES[frequency]


@pytest.mark.parametrize('amplitude', [0.2, 2.0, 10.0])
@pytest.mark.parametrize('frequency', [10.0, 30.0, 100.0, 200.0])
def test_the_default_beats_the_best_pid_on_sines(frequency, amplitude):
    errors = [
        tracked(overlaid('pid_for_sines'), frequency, 4.0, amplitude, controller, 2.0).rms_error
        for controller in ('adaptive_nn', 'pid')
    ]
    assert errors[0] < 0.55 * errors[1]


@pytest.mark.parametrize('height', [0.5, 5.0])
@pytest.mark.parametrize('waveform', ['step', 'square'])
def test_the_default_settles_sooner_than_pid_and_overshoots_less(waveform, height):
    reference = {'waveform': waveform, 'amplitude': height, 'start_time': 0.05}
    if waveform == 'square':
        reference |= {'amplitude': 0.5 * height, 'frequency': 10.0, 'start_time': 0.0}
    overshoot, settling = [], []
    for controller in ('adaptive_nn', 'pid'):
        rows = run(overlaid(), reference, 1.04 if waveform == 'square' else 0.25, controller)
        edges = step_response(rows.time, rows.reference[:, 0], rows.head[:, 0])
        # The first edge of the square wave is half as high.
        overshoot.append(float(edges.overshoot[-15:].max()))
        settling.append(float(edges.settling_time[-15:].max()))
    assert overshoot[0] < 2.0 < 15.0 < overshoot[1]
    assert settling[0] <= settling[1]


@pytest.mark.parametrize('amplitude', [0.2, 2.0, 10.0])
def test_a_chirp_through_the_whole_range(amplitude):
    reference = {
        'waveform': 'chirp',
        'amplitude': amplitude,
        'frequency': 10.0,
        'end_frequency': 500.0,
        'sweep_time': 4.0,
        'sweep': 'logarithmic',
    }
    rows = run(overlaid(), reference, 4.0)
    error = 1e3 * np.abs(rows.head[:, 0] - rows.reference[:, 0])
    # Up to 200 Hz, after the start at which the reference already moves; then the whole.
    assert error[1000:30000].max() < 6.0 + 2.0 * amplitude
    assert error.max() < 10.0 + 11.0 * amplitude


@pytest.mark.parametrize(('frequency', 'at_most'), [(20.0, 12.0), (50.0, 9.0), (100.0, 2.5), (200.0, 1.8)])
def test_compensator_goes_below_the_third_harmonic_and_stays_there_for_a_minute(frequency, at_most):
    sections = overlaid('thesis_law', 'step_references', 'hysteresis_compensator')
    assert tracked(sections, frequency, 10.0).rms_error < at_most
    assert tracked(sections, frequency, 60.0).rms_error < at_most


def test_compensator_lag_keeps_500_hz_steady_where_the_leakage_is_weak():
    weak = {'compensator.enabled': True, 'compensator.leakage': 20.0}
    sections = overlaid('thesis_law', 'step_references', 'hysteresis_compensator')
    nn = sections['adaptive_nn_controller']
    errors = [
        tracked({**sections, 'adaptive_nn_controller': {**nn, **weak, 'compensator.lag': lag}}, 500.0, 60.0).rms_error
        for lag in (0.0, nn['compensator.lag'])
    ]
    assert errors[1] < 13.0 < 2.0 * 13.0 < errors[0]


def test_thesis_gains_track_its_sines_and_the_printed_signs_do_not():
    sections = overlaid('thesis_law', 'thesis_gains')
    assert tracked(sections, 100.0, 10.0).rms_error < 6.0
    assert tracked(sections, 200.0, 10.0).rms_error < 4.0
    nn = sections['adaptive_nn_controller']
    printed = {**nn, 'sigma.gain': -nn['sigma.gain'], 'mass.gain': -nn['mass.gain']}
    assert tracked({**sections, 'adaptive_nn_controller': printed}, 100.0, 2.0).rms_error > 1e6
