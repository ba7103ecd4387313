"""The stability margin that a report states, against the linear loop itself."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.analysis.linear_laws import FrozenEstimates
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_sensitivity import low_margin_of, run_sensitivity
from hdd_servo_ros.tools.report import main

PARAMS = Path(__file__).parents[2] / 'params'
THESIS_LAW = PARAMS / 'thesis_law.yaml'
CHANGE = """/**/deterministic_timer:
  ros__parameters:
    schedule: ['0.05 adaptive_nn_controller {} {}']
"""


def metrics(run):
    return {metric.name: metric.value for metric in run_metrics(run)}


def test_the_bare_law_at_50_hz_is_told_of(simulated, tmp_path, capsys):
    """142 nm rms after a minute, and peaks of 1.3 um: m_hat takes the damping off the loop."""
    arguments = ('--params-file', str(THESIS_LAW), '-p', 'frequency:=50.0', '-p', 'duration:=5.0')
    run = Run.open(simulated(tmp_path / 'run', *arguments))
    assert 1e3 * np.sqrt(np.mean(run.error[run.time > 2.0] ** 2)) > 50.0
    found = run_sensitivity(run)
    assert found is not None
    sigma_hat, m_hat = (run.estimates[name][found.largest_tick] for name in ('sigma_hat', 'm_hat'))
    law = from_mapping(AdaptiveNnParameters, read_parameter_files([THESIS_LAW])['adaptive_nn_controller'])
    loop = LoopSurroundings(PlantParameters(), 1e-4).frozen_loop(AdaptiveNn(law, 1e-4))
    at_largest = loop.peak_sensitivity(FrozenEstimates(float(sigma_hat), float(m_hat)))
    assert found.largest == pytest.approx(at_largest, rel=1e-3)
    finer = max(
        loop.peak_sensitivity(FrozenEstimates(float(run.estimates['sigma_hat'][k]), float(run.estimates['m_hat'][k])))
        for k in range(0, 50_001, 250)
    )
    assert found.largest > 4.0
    assert found.largest > 0.8 * finer
    assert main([str(run.path), '--output', str(tmp_path / 'out')]) == 0
    assert 'low stability margin: the linear loop, with the estimates at ' in capsys.readouterr().out
    content = yaml.safe_load((tmp_path / 'out' / 'metrics.yaml').read_text())
    assert 'above 2.2' in content['low_stability_margin']
    assert content['metrics']['largest_peak_sensitivity']['value'] == pytest.approx(found.largest)
    page = (tmp_path / 'out' / 'report.html').read_text()
    assert 'low stability margin' in page
    assert 'peak sensitivity Ms, estimates at the end' in page


def test_the_bare_law_at_100_hz_keeps_its_margin(simulated, tmp_path):
    run = Run.open(simulated(tmp_path / 'run', '--params-file', str(THESIS_LAW), '-p', 'duration:=3.0'))
    found = run_sensitivity(run)
    assert found is not None
    # It falls from that of the start as m_hat comes to the effective mass of presliding.
    assert found.at_end < 1.8
    assert 1.99 < found.largest < 2.01
    assert found.largest_tick < 100
    assert low_margin_of(run) == ''
    assert metrics(run)['peak_sensitivity'] == found.at_end


def test_with_desired_compensation_the_margin_is_the_same_all_along(simulated, tmp_path):
    run = Run.open(simulated(tmp_path / 'run', '-p', 'frequency:=50.0', '-p', 'duration:=0.5'))
    found = run_sensitivity(run)
    assert found is not None
    assert found.at_end == found.largest == pytest.approx(1.98, abs=0.01)
    assert low_margin_of(run) == ''


@pytest.mark.parametrize(
    ('values', 'expected', 'low'),
    [((), 2.0, False), (('-p', 'vcm_plant:actuator.driver:=current'), 2.168, True)],
)
def test_the_pid_controller(simulated, tmp_path, values, expected, low):
    run = Run.open(simulated(tmp_path / 'run', '-p', 'controller:=pid', '-p', 'duration:=0.1', *values))
    assert metrics(run)['peak_sensitivity'] == pytest.approx(expected, abs=2e-3)
    assert 'largest_peak_sensitivity' not in metrics(run)
    assert low_margin_of(run).startswith('low stability margin: the linear loop has') == low


def test_an_unstable_loop(simulated, tmp_path):
    values = ('-p', 'vcm_plant:actuator.driver:=voltage', '-p', 'vcm_plant:actuator.amplifier_gain:=0.4')
    run = Run.open(simulated(tmp_path / 'run', '-p', 'controller:=pid', '-p', 'duration:=0.1', *values))
    assert metrics(run)['peak_sensitivity'] == math.inf
    assert 'is unstable' in low_margin_of(run)


@pytest.mark.parametrize(('name', 'value', 'known'), [('feedback_gain', '7.0e-5', False), ('reset_count', '1', True)])
def test_changed_parameters(simulated, tmp_path, name, value, known):
    (tmp_path / 'change.yaml').write_text(CHANGE.format(name, value))
    run = Run.open(simulated(tmp_path / 'run', '--params-file', str(tmp_path / 'change.yaml'), '-p', 'duration:=0.1'))
    assert [change.name for change in run.parameter_changes] == [name]
    assert ('peak_sensitivity' in metrics(run)) == known
    why = 'no peak sensitivity: parameters of adaptive_nn_controller were changed during the run'
    assert (why in left_out(run)) == (not known)
