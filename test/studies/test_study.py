"""Framework of `study`: the runs that it makes and reuses, and its error messages."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from typing import Any

import pytest
import yaml

from hdd_servo_ros.campaign.case import Case, parameter_file
from hdd_servo_ros.campaign.runner import StudyError, run_cases
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import ArgumentError, parse_ros_arguments
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.studies.chapter import CHAPTERS, figures
from hdd_servo_ros.studies.main import main

SHORT = {'deterministic_timer:duration': 0.02}


def case(name='a', controller='pid', **overrides):
    return Case(
        name, controller, ('simulation_study.yaml',), {key.replace('__', ':'): v for key, v in overrides.items()}
    )


def run(directory, *cases, defaults=SHORT):
    printed: list[str] = []
    run_cases(cases, directory, without_ros=True, defaults=defaults, report=printed.append)
    return printed


def test_arguments_survive_the_command_line(tmp_path):
    values = {'x:flag': True, 'x:gain': 1e-05, 'x:list': (1.0, 2.5e-3), 'x:text': '42', 'x:count': 3, 'x:name': 'N'}
    parsed = parse_ros_arguments(Case('a', 'pid', (), values).arguments({'x:count': 2}, tmp_path / 'a b'))
    assert parsed.parameters_of('x') == {key.split(':')[1]: value for key, value in values.items()} | {
        'controller': 'pid',
        'plot': False,
        'run_dir': str(tmp_path / 'a b'),
    }


def test_a_missing_parameter_file():
    assert parameter_file('simulation_study.yaml').is_file()
    with pytest.raises(ArgumentError, match='no_such'):
        parameter_file('no_such.yaml')


def test_finished_runs_are_reused_and_changed_ones_run_again(tmp_path):
    run(tmp_path, case('a'), case('b', 'adaptive_nn'), case('a'))
    written = {name: (tmp_path / name / 'run.yaml').stat().st_mtime_ns for name in 'ab'}
    printed = run(tmp_path, case('a', pid_controller__proportional_gain=7.0), case('b', 'adaptive_nn'))
    assert 'a runs again: pid_controller:proportional_gain is 159.0, not 7.0' in printed
    assert any(line.startswith('1 of 2 runs with these') for line in printed)
    assert (tmp_path / 'b' / 'run.yaml').stat().st_mtime_ns == written['b']
    assert (tmp_path / 'a' / 'run.yaml').stat().st_mtime_ns > written['a']
    assert not list(tmp_path.glob('*.log'))


@pytest.mark.parametrize(('change', 'why'), [({'status': 'interrupted'}, 'interrupted'), ({'nodes': {}}, 'it has no')])
def test_a_run_that_does_not_match_the_case_is_repeated(tmp_path, change, why):
    run(tmp_path, case())
    file = tmp_path / 'a' / 'run.yaml'
    file.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text()), **change}))
    assert any(why in line for line in run(tmp_path, case()))
    assert yaml.safe_load(file.read_text())['status'] == 'finished'


def test_nothing_runs_if_a_parameter_is_wrong(tmp_path):
    with pytest.raises(ParameterError, match=r'ldv_sensor:adc_bits'):
        run(tmp_path / 'out', case('a'), case('b', ldv_sensor__adc_bits=-3))
    with pytest.raises(StudyError, match="two different cases have the name 'a'"):
        run(tmp_path / 'out', case('a'), case('a', 'open_loop'))
    assert not (tmp_path / 'out').exists()


def test_a_directory_that_is_not_a_run_is_not_overwritten(tmp_path):
    (tmp_path / 'a').mkdir()
    (tmp_path / 'a' / 'thesis.tex').touch()
    with pytest.raises(StudyError, match='not a run folder'):
        run(tmp_path, case())
    assert (tmp_path / 'a' / 'thesis.tex').exists()


def test_two_studies_do_not_share_a_directory(tmp_path):
    descriptor = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with pytest.raises(StudyError, match='another study is running'):
        run(tmp_path, case())
    os.close(descriptor)
    run(tmp_path, case())


def test_a_failed_run_ends_the_study_with_its_reason(tmp_path):
    unstable = case('b', pid_controller__derivative_gain=1e8, pid_controller__control_limit=1e308)
    unstable.overrides['vcm_plant:control_limit'] = 1e308
    with pytest.raises(StudyError, match=r'(?s)run b failed with exit code 1.*not finite at tick'):
        run(tmp_path, unstable, defaults={'deterministic_timer:duration': 2.0})
    # The failed run is recorded as such, and the next call repeats it.
    with pytest.raises(StudyError, match='run b failed'):
        run(tmp_path, unstable, defaults={'deterministic_timer:duration': 2.0})


@pytest.mark.parametrize('chapter', CHAPTERS)
def test_each_figure_has_a_title(chapter):
    for name, figure in figures(chapter).items():
        assert figure.__doc__.strip().splitlines()[0].endswith('.'), name
        assert figure.CASES, name


def test_wrong_arguments_have_exit_code_2(tmp_path, capsys):
    with pytest.raises(SystemExit, match='2'):
        main(['chapter9'])
    assert main(['chapter4', '--only', 'fig_9_9']) == 2
    assert main(['chapter4', '--output', str(tmp_path), '--sample-time', '3e-4']) == 2
    assert main(['chapter4', '--output', str(tmp_path), '--sample-time', '0.05']) == 2
    assert not list(tmp_path.iterdir())
    error = capsys.readouterr().err
    assert 'fig_9_9' in error
    # 1/50 of the period of 5 rad/s.
    assert 'would have 25.1 samples per reference period, fewer than 50; expected at most 0.0251 s' in error
    assert 'a multiple of sample_time = 0.0003 s' in error


def test_the_graph_gives_the_same_bits(tmp_path, monkeypatch, bench):
    """One case through `rig`, whose bag must equal that of `simulate`."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(bench.domain))
    one = case('a', 'adaptive_nn')
    for directory, without_ros in (('graph', False), ('plain', True)):
        run_cases([one], tmp_path / directory, without_ros=without_ros, defaults=SHORT, report=lambda line: None)
    assert compare_bags([str(tmp_path / 'graph' / 'a'), str(tmp_path / 'plain' / 'a')]) == 0
    run_cases([one], tmp_path / 'graph', without_ros=True, defaults=SHORT, report=lambda line: None)
    assert 'rig' not in (tmp_path / 'graph' / 'a' / 'log.txt').read_text()


def test_an_interrupted_study_leaves_no_process_behind(tmp_path):
    study = [sys.executable, '-m', 'hdd_servo_ros.studies.main', 'chapter4', '--without-ros', '--output', str(tmp_path)]
    # Tests that run in the background of a shell script inherit an ignored SIGINT.
    heeding: dict[str, Any] = {'preexec_fn': lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(study, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **heeding) as process:
        deadline = time.monotonic() + 200.0
        while not any(bag.stat().st_size > 1e6 for bag in tmp_path.glob('*/bag/*')) and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=200)
    assert process.returncode == 130, error
    assert 'interrupted' in error
    assert 'interrupted' in {yaml.safe_load(file.read_text())['status'] for file in tmp_path.glob('*/run.yaml')}
    assert str(tmp_path) not in os.popen('ps -ww -o args -e').read()
