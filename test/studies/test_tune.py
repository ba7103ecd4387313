"""The tuning rule: that it keeps what it promises, and that the shipped numbers are its result."""

from pathlib import Path

import pytest

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.loop.experiment import Experiment
from hdd_servo_ros.loop.metrics import tracking_metrics
from hdd_servo_ros.loop.sensitivity import LinearController, LoopMargins
from hdd_servo_ros.parameter_files import read_parameter_files
from hdd_servo_ros.parameters import ParameterError, from_mapping
from hdd_servo_ros.studies.tune import (
    largest,
    largest_gain_on_r,
    main,
    round_down,
    round_up,
    tune_adaptive_nn,
    tune_pid,
    tune_pid_same_peak,
)

T = 1e-4
PARAMS = Path(__file__).parents[2] / 'params'
SHIPPED = read_parameter_files([PARAMS / 'seagate_7200_10.yaml'])


def test_rounding():
    assert round_down(0.0012399) == 0.00123
    assert round_down(5.0e-5) == 5.0e-5
    assert round_up(0.0012301) == 0.00124
    assert round_up(163000.0) == 163000.0


def test_largest():
    assert largest(lambda x: x <= 7.0, 1.0) == pytest.approx(7.0, rel=2e-4)
    assert largest(lambda x: x <= 7.0, 8.0) == 0.0


def test_shipped_adaptive_nn_is_the_rules_result():
    found = tune_adaptive_nn(PlantParameters(), T, AdaptiveNnParameters())
    shipped = {name: SHIPPED['adaptive_nn_controller'][name] for name in found}
    assert shipped.pop('network.gain') == pytest.approx(found.pop('network.gain'), rel=1e-9)
    assert shipped == pytest.approx(found, rel=1e-9)


def test_step_references_are_the_rules_result():
    overlaid = read_parameter_files([PARAMS / 'seagate_7200_10.yaml', PARAMS / 'step_references.yaml'])
    base = from_mapping(AdaptiveNnParameters, overlaid['adaptive_nn_controller'])
    found = tune_adaptive_nn(PlantParameters(), T, base)
    shipped = {name: overlaid['adaptive_nn_controller'][name] for name in found}
    assert shipped.pop('network.gain') == pytest.approx(found.pop('network.gain'), rel=1e-9)
    assert shipped == pytest.approx(found, rel=1e-9)
    g = found['safe_gain']
    law = LinearController(g * base.error_filter_lambda, g, g * base.integral_gain)
    assert 1.9 < LoopMargins(PlantParameters(), T).peak_sensitivity(law) <= 2.0


def test_shipped_pid_is_the_rules_result():
    found = tune_pid(PlantParameters(), T, {})
    shipped = {name: SHIPPED['pid_controller'][name] for name in found}
    assert shipped == pytest.approx(found, rel=1e-9)


def test_shipped_gains_for_one_sample_of_delay_are_the_rules_result():
    file = read_parameter_files([PARAMS / 'one_sample_delay.yaml'])
    base = from_mapping(
        AdaptiveNnParameters,
        {name: value for name, value in file['adaptive_nn_controller'].items() if not name.startswith('dsp.')},
    )
    found = tune_adaptive_nn(PlantParameters(), T, base, delay=1)
    shipped = {name: file['adaptive_nn_controller'][name] for name in found}
    assert shipped.pop('network.gain') == pytest.approx(found.pop('network.gain'), rel=1e-9)
    assert shipped == pytest.approx(found, rel=1e-9)
    found = tune_pid(PlantParameters(), T, file)
    assert {name: file['pid_controller'][name] for name in found} == pytest.approx(found, rel=1e-9)


def test_the_rule_holds_for_both():
    margins = LoopMargins(PlantParameters(), T)
    nn = from_mapping(AdaptiveNnParameters, SHIPPED['adaptive_nn_controller'])
    g = AdaptiveNn(nn, T).gain_on_r
    assert margins.peak_sensitivity(LinearController(g * nn.error_filter_lambda, g)) <= 2.0
    assert g == pytest.approx(nn.safe_gain, rel=0.01)
    pid = SHIPPED['pid_controller']
    law = LinearController(
        pid['proportional_gain'], pid['derivative_gain'], pid['integral_gain'], pid['derivative_bandwidth']
    )
    assert margins.peak_sensitivity(law) <= 2.0


@pytest.mark.parametrize('overlays', [(), ('lambda_10',), ('lambda_15', 'feedforward_15')], ids='-'.join)
def test_same_peak_finds_the_shipped(overlays):
    """At T = 1 ms, for speed; the shipped gains are the result at 0.1 ms."""
    names = ('simulation_study', *(f'simulation_study_{overlay}' for overlay in overlays))
    sections = read_parameter_files([PARAMS / f'{name}.yaml' for name in names])

    def metrics(controller, gains):
        node = f'{controller}_controller'
        rows = Experiment(1e-3, controller, {**sections, node: {**sections[node], **gains}}).run(0, 20001)
        return tracking_metrics(
            rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], transient=10.0, unit=1.0
        )

    found = metrics('pid', tune_pid_same_peak(sections, 1e-3))
    shipped = metrics('pid', {})
    assert found.peak_control <= 1.001 * metrics('adaptive_nn', {}).peak_control
    # At the coarser T the peak is up to 4 % higher, which leaves room for more gain.
    assert found.rms_error == pytest.approx(shipped.rms_error, rel=0.12)


def test_a_hopeless_lambda_is_refused():
    with pytest.raises(ParameterError, match='error_filter_lambda = 50000'):
        largest_gain_on_r(LoopMargins(PlantParameters(), T), 50000.0)


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--params-file', 'no_such.yaml'], 'parameter file no_such.yaml'),
        (['--params-file', 'hopeless.yaml'], 'error_filter_lambda = 2500.0 is refused'),
        (['--sample-time', '-1'], 'sample_time = -1.0 is refused'),
        (['--same-peak', '--sample-time', '0'], 'sample_time = 0.0 is refused'),
        (['--seconds', '2'], '--seconds 2 is no more than the 2 s that do not count'),
    ],
)
def test_wrong_arguments(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    section = '/**/adaptive_nn_controller:\n  ros__parameters:\n    error_filter_lambda: 2500.0\n'
    (tmp_path / 'hopeless.yaml').write_text(section)
    assert main(arguments) == 2
    errors = capsys.readouterr().err
    assert said in errors
    assert errors.count('\n') == 1


def test_the_command_prints_a_parameter_file(tmp_path, capsys):
    assert main(['--seconds', '2.5']) == 0
    text = capsys.readouterr().out
    file = tmp_path / 'tuned.yaml'
    file.write_text(text[: text.index('\nMs of')])
    assert set(read_parameter_files([file])) == {'adaptive_nn_controller', 'pid_controller'}
    assert text.count(' Hz ') == 6
