"""Runs for the tuning of controllers: overshoot of steps, compared with new experiments."""

import math
from pathlib import Path

import pytest

from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies.tuning_runs import Steps

T = 1e-4
SECTIONS = read_parameter_files([Path(__file__).parents[2] / 'params' / 'seagate_7200_10.yaml'])
GAINS = {
    'proportional_gain': 0.16,
    'integral_gain': 2240.0,
    'derivative_gain': 2.332e-4,
    'derivative_bandwidth': 1491.0,
}


def overshoot(gains, height):
    step = {'waveform': 'step', 'amplitude': height, 'start_time': 0.001}
    own = {**SECTIONS['pid_controller'], **gains}
    experiment = Experiment(T, 'pid', {**SECTIONS, 'pid_controller': own, 'reference_generator': step})
    return 100.0 * (experiment.run(0, 1001).head[:, 0].max() / height - 1.0)


def test_the_overshoot_is_that_of_new_experiments():
    steps = Steps(SECTIONS, T)
    for gains in ({}, GAINS, {}):
        largest = max(overshoot(gains, height) for height in (0.5, 5.0))
        assert steps.overshoot(gains) == pytest.approx(largest, rel=1e-12)
    assert steps.overshoot(GAINS) == pytest.approx(84.8, abs=0.1)


def test_steps_are_skipped_once_the_limit_is_exceeded():
    assert Steps(SECTIONS, T).overshoot(GAINS, limit=50.0) > 50.0


def test_a_run_that_diverges_exceeds_any_limit():
    limitless: dict[str, dict[str, object]] = {
        'vcm_plant': {**SECTIONS['vcm_plant'], 'control_limit': 1e308},
        'ldv_sensor': {'adc_bits': 0, 'output_range': 0.0},
        'pid_controller': {'control_limit': 1e308},
    }
    assert Steps(limitless, T).overshoot({**GAINS, 'derivative_gain': 5e-3}) == math.inf
