"""Duration, pieces and output of a run of `simulate`."""

import itertools
import signal
import threading

import pytest

from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.simulation.interrupts import interrupts
from hdd_servo_ros.simulation.run_setup import CHUNK, Simulation
from hdd_servo_ros.simulation.simulate import main, simulate

SCALES = ('displacement_scale', 'velocity_scale')
CHANGE = '{:.4f} ldv_sensor noise false'


def simulation(*overrides):
    return Simulation(parse_ros_arguments(['--ros-args', *(word for value in overrides for word in ('-p', value))]))


def test_the_pieces_of_a_run_end_at_its_changes_and_at_its_end():
    changes = f"schedule:=['{CHANGE.format(0.01)}','{CHANGE.format(1e-4 * CHUNK)}']"
    pieces = list(simulation('duration:=1.0', changes).pieces(10_000))
    assert pieces == [(0, 100), (100, CHUNK - 100), (CHUNK, CHUNK), (2 * CHUNK, 10_001 - 2 * CHUNK)]


def test_a_run_of_many_years_begins_at_once():
    run = simulation('duration:=1e9')
    assert list(itertools.islice(run.pieces(run.last_tick), 2)) == [(0, CHUNK), (CHUNK, CHUNK)]


@pytest.mark.parametrize(
    'overrides',
    [
        ('duration:=1e10',),
        ('duration:=0.0', 'controller:=signal_analyzer', 'start_frequency:=0.001', 'settle_cycles:=1e6'),
    ],
)
def test_a_run_that_no_stamp_can_count_is_rejected(overrides):
    with pytest.raises(ParameterError, match=r'duration: .*; expected .*at most 2e\+09'):
        simulation(*overrides)


@pytest.mark.parametrize('scale', SCALES)
@pytest.mark.parametrize('node', ['ldv_sensor', 'adaptive_nn_controller'])
def test_a_scale_is_fixed_during_a_run(node, scale):
    """The controllers have taken it before tick 0."""
    with pytest.raises(ParameterError, match=f'{scale} is read-only'):
        simulation(f"schedule:=['0.01 {node} {scale} 4.0']")


def summary_lines(text):
    """Return the lines of a summary by their names."""
    return dict(line.strip().split('  ', 1) for line in text.splitlines())


@pytest.mark.parametrize(
    'more',
    [
        (),
        ('-p', "schedule:=['0.3 reference_generator amplitude 1.0']"),
        ('-p', "schedule:=['0.7 reference_generator amplitude 1.0','0.9 ldv_sensor noise false']"),
    ],
    ids=['no change', 'early change', 'late change'],
)
def test_a_run_that_is_not_recorded_prints_the_same_summary(tmp_path, capsys, more):
    """From its rows, piece by piece, what the recorded one prints from its bag."""
    arguments = ['--ros-args', '-p', 'duration:=1.0', '-p', 'progress:=false', '-p', 'plot:=false', *more]
    assert main([*arguments, '-p', f'run_dir:={tmp_path / "run"}']) == 0
    recorded = summary_lines(capsys.readouterr().out)
    assert main([*arguments, '-p', 'record:=false']) == 0
    rows = summary_lines(capsys.readouterr().out)
    assert rows['run'] == 'finished, tracks'
    assert rows.keys() == recorded.keys() - {'messages', 'run folder'}
    assert {name: rows[name] for name in rows if name != 'real-time factor'} == {
        name: recorded[name] for name in rows if name != 'real-time factor'
    }


def test_a_sweep_that_is_not_recorded_prints_the_same_response(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ['controller:=signal_analyzer', 'duration:=0.0', 'start_frequency:=2000.0', 'stop_frequency:=4000.0']
    words += ['points_per_decade:=[10]', 'settle_time:=0.002', 'integrate_time:=0.002']
    words += ['progress:=false', 'plot:=false']
    arguments = ['--ros-args', *(word for value in words for word in ('-p', value))]
    assert main([*arguments, '-p', 'run_dir:=run']) == 0
    recorded = summary_lines(capsys.readouterr().out)
    assert main([*arguments, '-p', 'record:=false']) == 0
    assert summary_lines(capsys.readouterr().out) == {'response': recorded['response']}


def test_a_run_off_the_main_thread(tmp_path):
    """Python allows signal handlers on the main thread alone; a run elsewhere does without."""
    directory = tmp_path / 'run'
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    ended = []
    thread = threading.Thread(
        target=lambda: ended.append(
            simulate(simulation('duration:=0.01', f'run_dir:={directory}'), progress=False),
        )
    )
    thread.start()
    thread.join()
    assert ended == [(0, directory)]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == handlers


def test_handlers_are_as_before_afterwards():
    before = signal.getsignal(signal.SIGTERM)
    with interrupts() as requests:
        signal.raise_signal(signal.SIGTERM)
        assert requests.number == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is before
