"""Sensor scales of a controller."""

import pytest

from hdd_servo_ros.bench.dsp import ControllerInputParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.graph.block_parameters import input_parameters, sensor_scales
from hdd_servo_ros.parameters import ParameterError

SENSOR = LdvParameters(displacement_scale=4.0, velocity_scale=2000.0)


@pytest.mark.parametrize(
    ('own', 'expected'),
    [
        ({}, (4.0, 2000.0)),
        ({'displacement_scale': 8.0}, (8.0, 2000.0)),
        ({'velocity_scale': 5000.0}, (4.0, 5000.0)),
        ({'displacement_scale': 8.0, 'velocity_scale': 5000.0}, (8.0, 5000.0)),
    ],
)
def test_own_scales_take_precedence_and_zero_selects_those_of_the_sensor(own, expected):
    assert sensor_scales(ControllerInputParameters(**own), SENSOR) == expected
    assert sensor_scales(input_parameters('pid_controller', {**own, 'control_limit': 3.0}), SENSOR) == expected


def test_a_bad_scale_is_rejected_by_name():
    with pytest.raises(ParameterError, match=r'pid_controller\.displacement_scale: -1\.0;'):
        input_parameters('pid_controller', {'displacement_scale': -1.0})
