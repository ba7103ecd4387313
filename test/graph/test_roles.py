"""Nodes that fill the roles of a run."""

import pytest

from hdd_servo_ros.graph.catalog import CONTROLLER, DISTURBANCE_SOURCE, nodes_of_run
from hdd_servo_ros.graph.roles import roles_of_run
from hdd_servo_ros.messages.topics import BASE_SENSOR, POSITION_SENSOR
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.files import parse_ros_arguments

PLAYED = {DISTURBANCE_SOURCE: 'playback'}
GENERATED = {DISTURBANCE_SOURCE: 'disturbance_generator'}
MEASURED = {BASE_SENSOR: 'accelerometer'}


def roles(words, controller='pid_controller'):
    return roles_of_run(controller, parse_ros_arguments(['--ros-args', *words]))


@pytest.mark.parametrize(
    ('words', 'more'),
    [
        ([], {}),
        (['-p', 'recorded_run:=runs/shaken'], PLAYED),
        (['-p', 'playback:recorded_run:=runs/shaken'], PLAYED),
        (['-p', "playback:recorded_run:=''"], {}),
        (['-p', 'vcm_plant:recorded_run:=runs/shaken'], {}),
        (['-p', 'disturbance_generator:shock.enabled:=true'], GENERATED),
        (['-p', 'shock.enabled:=true'], {}),
        (['-p', 'disturbance_generator:shock.enabled:=true', '-r', '__ns:=/bench1'], {}),
        (['-p', 'feedforward.method:=fixed'], MEASURED),
        (['-p', 'pid_controller:feedforward.method:=fixed'], MEASURED),
        (['-p', 'pid_controller:feedforward.method:=none'], {}),
        (['-p', 'adaptive_nn_controller:feedforward.method:=fixed'], {}),
        (['-p', 'accelerometer:seed:=2', '-p', 'disturbance_generator:shock.enabled:=true'], GENERATED | MEASURED),
    ],
)
def test_nodes_requested_by_arguments(words, more):
    assert roles(words) == {CONTROLLER: 'pid_controller', **more}


@pytest.mark.parametrize(
    ('section', 'namespace', 'is_named'),
    [
        ('/**/disturbance_generator', '/', True),
        ('/**/disturbance_generator', '/bench1', True),
        ('disturbance_generator', '/', True),
        ('/bench1/disturbance_generator', '/bench1', True),
        ('/bench2/disturbance_generator', '/bench1', False),
        ('/**', '/', False),
        ('/*', '/', False),
    ],
)
def test_a_section_of_its_own_names_a_node(tmp_path, section, namespace, is_named):
    file = tmp_path / 'parameters.yaml'
    file.write_text(f'{section}:\n  ros__parameters:\n    shock:\n      enabled: true\n')
    found = roles(['--params-file', str(file), '-r', f'__ns:={namespace}'])
    assert found == {CONTROLLER: 'pid_controller', **(GENERATED if is_named else {})}


def test_a_recorded_and_a_generated_disturbance_are_rejected():
    words = ['-p', 'playback:recorded_run:=runs/shaken', '-p', 'disturbance_generator:shock.enabled:=true']
    with pytest.raises(
        ParameterError, match=r"playback:recorded_run: 'runs/shaken'; expected an empty string with parameters"
    ):
        roles(words)


def test_the_servo_sensor_replaces_the_vibrometer():
    arguments = parse_ros_arguments([])
    assert nodes_of_run(roles_of_run('pid_controller', arguments)) == nodes_of_run({CONTROLLER: 'pid_controller'})
    found = roles_of_run('pid_controller', arguments, 'servo')
    assert found == {CONTROLLER: 'pid_controller', POSITION_SENSOR: 'servo_sensor'}
    names = nodes_of_run(found)
    assert 'ldv_sensor' not in names
    assert names.index('vcm_plant') + 1 == names.index('servo_sensor')


def test_a_controller_that_measures_ldv_rejects_the_servo_sensor():
    with pytest.raises(ParameterError, match=r"sensor: 'servo'; expected ldv, because signal_analyzer measures /ldv"):
        roles_of_run('signal_analyzer', parse_ros_arguments([]), 'servo')
