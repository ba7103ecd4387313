"""A run in memory is the run that `simulate` records: the same signals, description, changes, metrics and verdict."""

import json

import numpy as np
import pytest

from hdd_servo_ros.campaign.case import parameter_file
from hdd_servo_ros.campaign.start import run_arguments
from hdd_servo_ros.messages.topics import SIGNAL_TOPICS
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.recorded_run import RecordedRun
from hdd_servo_ros.recording.signals_digest import signals_digest
from hdd_servo_ros.reporting.run_metrics import run_metrics
from hdd_servo_ros.reporting.verdict import verdict_of
from hdd_servo_ros.simulation import simulate
from hdd_servo_ros.simulation.in_memory import run_in_memory
from hdd_servo_ros.simulation.run_setup import Simulation

CASES: dict[str, tuple[list[str], dict[str, object]]] = {
    'adaptive': (['seagate_7200_10.yaml'], {'controller': 'adaptive_nn'}),
    'steps': (['seagate_7200_10.yaml', 'step_references.yaml'], {'controller': 'adaptive_nn'}),
    'changed': (
        ['seagate_7200_10.yaml'],
        {
            'controller': 'pid',
            'schedule': ['0.1 reference_generator amplitude 1.0', '0.2 pid_controller proportional_gain 0.002'],
        },
    ),
    'shaken': (['nss_100ktpi.yaml', 'mobile_car.yaml'], {'duration': 0.37879, 'controller': 'adaptive_nn'}),
    'track': (['nss_100ktpi.yaml', 'seek_servo.yaml'], {'duration': 0.37879, 'controller': 'seek'}),
    'diverging': (['seagate_7200_10.yaml'], {'controller': 'pid', 'pid_controller:proportional_gain': 1.7e308}),
}

SHORT = ['--ros-args', '-p', 'duration:=0.01', '-p', 'controller:=pid']


@pytest.fixture(params=CASES)
def arguments(request, tmp_path):
    files, values = CASES[request.param]
    values = {'duration': 0.4, 'progress': False, **values}
    return run_arguments([parameter_file(file) for file in files], values, tmp_path / 'run')


def test_it_is_the_recorded_run(arguments, tmp_path):
    code = simulate.main(arguments)
    recorded = RecordedRun.open(tmp_path / 'run')
    run = run_in_memory(Simulation(parse_ros_arguments(arguments)))
    assert code == (0 if run.status == 'finished' else 1)
    assert (run.status, run.reason, run.last_tick) == (recorded.status, recorded.reason, recorded.last_tick)
    assert run.controller == recorded.controller
    assert run.counts == recorded.counts
    names = [topic.name for topic in SIGNAL_TOPICS if topic.name in recorded]
    assert names == [topic.name for topic in SIGNAL_TOPICS if topic.name in run]
    for name in names:
        np.testing.assert_array_equal(run[name], recorded[name], strict=True)
    assert signals_digest(run) == signals_digest(recorded)
    np.testing.assert_array_equal(run.time, recorded.time, strict=True)
    assert list(run.parameter_changes) == list(recorded.parameter_changes)
    assert json.loads(json.dumps(run.description['nodes'])) == recorded.description['nodes']
    found = [run_metrics(run), verdict_of(run)]
    assert repr(found) == repr([run_metrics(recorded), verdict_of(recorded)])


def test_the_digest_covers_each_bit():
    run = run_in_memory(
        Simulation(parse_ros_arguments(['--ros-args', '-p', 'duration:=0.01', '-p', 'controller:=pid']))
    )
    before = signals_digest(run)
    run['control'][50, 1] = np.nextafter(run['control'][50, 1], 1.0)
    assert signals_digest(run) != before


def test_it_has_no_messages():
    run = run_in_memory(
        Simulation(parse_ros_arguments(['--ros-args', '-p', 'duration:=0.01', '-p', 'controller:=pid']))
    )
    with pytest.raises(KeyError, match='not contain topic pes'):
        run['pes']
    with pytest.raises(BagError, match='run in memory: the bag does not contain topic head'):
        run.column('head')


def test_a_run_goes_to_pandas():
    pytest.importorskip('pandas')
    run = run_in_memory(Simulation(parse_ros_arguments(SHORT)))
    frame = run.to_dataframe()
    assert frame.index.name == 'tick'
    assert frame.index.tolist() == list(range(101))
    np.testing.assert_array_equal(frame['time'], run.time)
    np.testing.assert_array_equal(frame['head.position'], run.position)
    np.testing.assert_array_equal(frame['control.before_saturation'], run.control.before_saturation)
    for name, values in run.estimates.items():
        np.testing.assert_array_equal(frame[f'estimates.{name}'], values)


def test_a_run_reads_well():
    run = run_in_memory(Simulation(parse_ros_arguments(SHORT)))
    drive = run.description['frame_id']
    assert repr(run) == f"RunInMemory('run in memory', pid on {drive}, 101 ticks of 0.0001 s, finished)"
