"""Which nodes fill the roles of a run."""

import pytest

from hdd_servo_ros.graph.catalogue import CONTROLLER, DISTURBANCE_SOURCE
from hdd_servo_ros.graph.roles import roles_of_run
from hdd_servo_ros.parameters.files import parse_ros_arguments


@pytest.mark.parametrize(
    ('words', 'more'),
    [
        ([], {}),
        (['-p', 'recorded_run:=runs/shaken'], {DISTURBANCE_SOURCE: 'playback'}),
        (['-p', 'playback:recorded_run:=runs/shaken'], {DISTURBANCE_SOURCE: 'playback'}),
        (['-p', "playback:recorded_run:=''"], {}),
        (['-p', 'vcm_plant:recorded_run:=runs/shaken'], {}),
    ],
)
def test_a_recorded_run_asks_for_playback(words, more):
    roles = roles_of_run('pid_controller', parse_ros_arguments(['--ros-args', *words]))
    assert roles == {CONTROLLER: 'pid_controller', **more}
