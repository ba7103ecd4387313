"""`compare`: the runs that it makes, and agreement of its table with the bags."""

import csv
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.parameters.files import read_parameter_files
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.studies.compare import Candidate, Comparison, main

ROOT = Path(__file__).parents[2]
PATH = 'my_controller:MyController'


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a directory with the example controller."""
    shutil.copy(ROOT / 'examples' / 'my_controller.py', tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [*sys.path])
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    yield tmp_path
    sys.modules.pop('my_controller', None)
    NODES.pop('my_controller', None)


def table():
    with Path('out/compare.csv').open(newline='', encoding='utf8') as stream:
        return list(csv.DictReader(stream))


def test_cases():
    controllers = (Candidate('pid', 'pid_controller'), Candidate(PATH, 'my_controller'))
    overrides = {'my_controller:spring': 0.01, 'duration': 1.0, 'vcm_plant:gain': 5e7}
    cases = Comparison(controllers, {'slow': {'reference_generator:frequency': 5.0}}, ('a.yaml',), overrides).cases()
    assert list(cases) == [('slow', 'pid'), ('slow', 'my_controller')]
    pid, mine = cases.values()
    assert (pid.name, pid.controller, pid.files) == ('slow-pid', 'pid', ('a.yaml',))
    assert (mine.name, mine.controller) == ('slow-my_controller', PATH)
    common = {'reference_generator:frequency': 5.0, 'duration': 1.0, 'vcm_plant:gain': 5e7}
    assert pid.overrides == common
    assert mine.overrides == {**common, 'my_controller:spring': 0.01}


def test_a_parameter_without_a_node_goes_to_the_controllers_that_have_it():
    controllers = tuple(Candidate.named(name) for name in ('pid', 'adaptive_nn', PATH))
    overrides = {'spring': 0.01, 'control_limit': 5.0, 'proportional_gain': 0.4, 'no_such': 1.0}
    cases = Comparison(controllers, {'slow': {}}, ('a.yaml',), overrides).cases()
    # The drive has a control_limit; each run rejects a parameter that no node has.
    everywhere = {'control_limit', 'no_such'}
    found = {controller: set(case.overrides) - everywhere for (_, controller), case in cases.items()}
    assert found == {'pid': {'proportional_gain'}, 'adaptive_nn': set(), 'my_controller': {'spring'}}
    assert all(everywhere <= case.overrides.keys() for case in cases.values())


def test_an_overlay_of_one_controller(capsys):
    """Given by path or by name of a shipped file; the label is the stem, and only its own runs use it."""
    Path('soft.yaml').write_text('/**/pid_controller:\n  ros__parameters:\n    proportional_gain: 0.2\n')
    arguments = ['--controllers', 'pid', 'pid@soft.yaml', 'pid@pid_for_sines.yaml', '--experiments', 'sine_100_hz']
    arguments += ['--without-ros', '--output', 'out', '-p', 'duration:=0.1', '-p', 'pid_controller:control_limit:=5.0']
    assert main(arguments) == 0
    assert [row['controller'] for row in table()] == ['pid', 'soft', 'pid_for_sines']
    gains = {}
    for label in ('pid', 'soft', 'pid_for_sines'):
        content = yaml.safe_load(Path(f'out/sine_100_hz-{label}/run.yaml').read_text())
        own = content['nodes']['/pid_controller']['parameters']
        assert own['control_limit'] == 5.0
        gains[label] = own['proportional_gain'], own['integral_gain']
    shipped = read_parameter_files([ROOT / 'params' / name for name in ('seagate_7200_10.yaml', 'pid_for_sines.yaml')])
    for_sines = shipped['pid_controller']
    assert gains['pid_for_sines'] == (for_sines['proportional_gain'], for_sines['integral_gain'])
    assert gains['soft'] == (0.2, gains['pid'][1])
    errors = {row['controller']: float(row['rms error [nm]']) for row in table()}
    assert errors['pid_for_sines'] < 0.5 * errors['pid'] < errors['soft']


@pytest.mark.parametrize(
    ('arguments', 'labels'),
    [
        ([], ['adaptive_nn', 'pid', 'pid_for_sines']),
        (['--params-file', str(ROOT / 'params' / 'seagate_7200_10.yaml')], ['adaptive_nn', 'pid']),
    ],
)
def test_the_controllers_by_default(arguments, labels):
    """The controller with the overlay is tuned only for the default drive."""
    short = ['--without-ros', '--output', 'out', '-p', 'duration:=0.06']
    assert main([*arguments, '--experiments', 'sine_100_hz', *short]) == 0
    assert [row['controller'] for row in table()] == labels


def test_the_table_is_that_of_the_bags(capsys):
    """Sine and step with two controllers: the values equal those computed from the signals by definition."""
    arguments = ['--controllers', 'pid', PATH, '--experiments', 'sine_100_hz', 'step_5_um', '--without-ros']
    arguments += ['--output', 'out', '-p', 'duration:=0.14', '-p', 'my_controller:spring:=0.01']
    assert main(arguments) == 0
    rows = table()
    pairs = [(experiment, name) for experiment in ('sine_100_hz', 'step_5_um') for name in ('pid', 'my_controller')]
    assert [(row['experiment'], row['controller']) for row in rows] == pairs
    for row in rows:
        signals = Run.open(Path('out') / f'{row["experiment"]}-{row["controller"]}')
        x_d, x = signals.reference[:, 0], signals.head[:, 0]
        error = 1e3 * (x - x_d)
        assert float(row['peak control, whole run [V]']) == np.abs(signals.control[:, 0]).max()
        if row['experiment'] == 'sine_100_hz':
            late = error[700:]
            assert float(row['rms error [nm]']) == pytest.approx(np.sqrt(np.mean(late**2)), rel=1e-12)
            assert float(row['max error [nm]']) == pytest.approx(np.abs(late).max(), rel=1e-12)
            assert row['overshoot, worst [%]'] == ''
        else:
            # Edges at 0, 50 and 100 ms, up, down, up.
            pieces = [(0, 500, 5.0), (500, 1000, -5.0), (1000, 1401, 5.0)]
            overshoot = max(100.0 * ((x[a:b] - x_d[a]) / height).max() for a, b, height in pieces)
            assert float(row['overshoot, worst [%]']) == pytest.approx(overshoot, rel=1e-9)
            outside = [np.flatnonzero(np.abs(x[a:b] - x_d[a]) > 0.1)[-1] + 1 for a, b, _ in pieces]
            assert float(row['2 % settling time, worst [ms]']) == pytest.approx(max(outside) * 0.1, rel=1e-6)
            steady = [abs(error[(a + b) // 2 : b].mean()) for a, b, _ in pieces]
            assert float(row['steady error, worst [nm]']) == pytest.approx(max(steady), rel=1e-9)
            assert row['rms error [nm]'] == ''
    spring = {row['controller']: float(row['rms error [nm]']) for row in rows[:2]}
    assert spring['my_controller'] < 0.8 * spring['pid']
    printed = capsys.readouterr().out
    assert Path('out/compare.md').read_text('utf8').strip() in printed
    assert f'| sine_100_hz | pid | tracks | {spring["pid"]:.3g} |' in printed
    assert {row['verdict'] for row in rows} == {'tracks'}
    assert Path('out/compare.png').stat().st_size > 20_000

    # A repetition makes no run; a changed controller file does.
    assert main(arguments) == 0
    assert '4 of 4 runs with these parameters are in out already' in capsys.readouterr().out
    with Path('my_controller.py').open('a') as stream:
        stream.write('# another controller\n')
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert '2 of 4 runs with these parameters are in out already' in printed
    assert 'sine_100_hz-my_controller runs again: my_controller has changed' in printed


def test_a_controller_that_does_not_track_is_marked(capsys):
    """One controller with a far too low voltage limit, and one without."""
    arguments = ['--controllers', 'pid', 'adaptive_nn', '--experiments', 'sine_100_hz', '--without-ros']
    arguments += ['--output', 'out', '-p', 'duration:=0.1', '-p', 'pid_controller:control_limit:=0.004']
    assert main(arguments) == 0
    assert {row['controller']: row['verdict'] for row in table()} == {
        'pid': '! saturated 100 %',
        'adaptive_nn': 'tracks',
    }
    assert '| sine_100_hz | pid | ! saturated 100 % |' in capsys.readouterr().out


def test_the_experiment_of_a_parameter_file():
    Path('fast.yaml').write_text('/**/reference_generator:\n  ros__parameters:\n    frequency: 150.0\n')
    default = str(ROOT / 'params' / 'seagate_7200_10.yaml')
    arguments = ['--controllers', 'pid', '--params-file', default, 'fast.yaml', '--without-ros']
    assert main([*arguments, '--output', 'out', '-p', 'duration:=0.02']) == 0
    assert [row['experiment'] for row in table()] == ['fast']
    content = yaml.safe_load(Path('out/fast-pid/run.yaml').read_text())
    assert content['nodes']['/reference_generator']['parameters']['frequency'] == 150.0


@pytest.mark.parametrize(
    ('answer', 'note', 'verdict'),
    [
        ('1.0 / (77 - inputs.tick)', 'failed: my_controller: step raised ZeroDivisionError: .* at tick 77', 'tracks'),
        (
            "float('nan')",
            r'failed: /control: not finite at tick 0: \(nan, nan, nan\); published by my_controller',
            '! diverged',
        ),
    ],
)
def test_a_failed_run_is_in_the_table(answer, note, verdict):
    source = Path('my_controller.py').read_text()
    Path('my_controller.py').write_text(source.replace('return p.spring', f'return {answer} + p.spring'))
    arguments = ['--controllers', PATH, 'pid', '--experiments', 'sine_100_hz', '--without-ros', '--output', 'out']
    assert main([*arguments, '-p', 'duration:=0.02']) == 1
    mine, pid = table()
    assert re.fullmatch(note, mine['note'])
    assert mine['rms error [nm]'] == ''
    assert (mine['verdict'], pid['verdict']) == (verdict, 'tracks')
    assert pid['note'] == ''
    assert float(pid['rms error [nm]']) > 0.0


@pytest.mark.parametrize(
    ('arguments', 'printed'),
    [
        (['--controllers', 'no_such'], "controller: 'no_such'; expected one of adaptive_nn, pid, seek, open_loop"),
        (['--params-file', 'no_such.yaml'], 'parameter file no_such.yaml'),
        (['-p', 'pid_controller:gian:=1.0'], 'did you mean gain?'),
        (['-p', 'controller:=pid'], '-p controller is rejected: compare sets it for each run; use --controllers'),
        (['-p', 'bag_recorder:run_dir:=there'], '-p bag_recorder:run_dir is rejected'),
        (['-p', 'bogus:=1'], 'compare: unknown parameter bogus'),
        (['--controllers', 'pid@'], '--controllers pid@: expected the name of a parameter file after the @'),
        (
            ['--controllers', 'pid@no_such.yaml'],
            "unknown parameter file 'no_such.yaml'",
        ),
        (['--controllers', 'pid', 'adaptive_nn', 'pid'], '--controllers names pid more than once'),
        (
            ['--output', '/proc/no_such'],
            'cannot create directory /proc/no_such: No such file or directory; choose another',
        ),
        (['-p', 'no:such'], "-p 'no:such' is not NODE:PARAMETER:=VALUE"),
        (['--output', 'my_controller.py'], 'my_controller.py is a file, not a directory'),
    ],
)
def test_wrong_arguments(capsys, arguments, printed):
    assert main(arguments) == 2
    errors = capsys.readouterr().err
    assert printed in errors
    assert errors.count('\n') == 1
    assert not Path('runs').exists()


def test_one_controller_by_two_names(capsys):
    with Path('my_controller.py').open('a') as file:
        file.write('\nOther = MyController\n')
    assert main(['--controllers', PATH, 'my_controller:Other']) == 2
    expected = f'compare: --controllers: {PATH} and my_controller:Other have the same label my_controller'
    assert capsys.readouterr().err.startswith(expected)


def test_through_the_graph_the_same_bits(bench):
    """The complete command through the graph; its bags equal those without it."""
    for mode in ([], ['--without-ros']):
        arguments = ['--controllers', PATH, '--experiments', 'sine_100_hz', '-p', 'duration:=0.05', *mode]
        answer = bench.python('-m', 'hdd_servo_ros.studies.compare', *arguments)
        assert answer.returncode == 0, answer.stderr + answer.stdout
        assert '1 of 1 runs: sine_100_hz-my_controller' in answer.stdout
    runs = bench.directory / 'runs'
    left, right = (runs / name / 'sine_100_hz-my_controller' for name in ('compare', 'compare-without-ros'))
    assert first_difference(left, right) is None
