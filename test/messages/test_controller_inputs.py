"""Conversion of the sensor's voltages to position and velocity; the other inputs are unchanged."""

from hdd_servo_ros.messages.controller_inputs import NO_INPUTS, ControllerInputs, SensorScales


def test_voltages_become_position_and_velocity():
    found = SensorScales(8.0, 5000.0).inputs(7, 0.5, -0.25, 1.0, 2.0, 3.0)
    assert found == ControllerInputs(
        tick=7,
        position=4.0,
        velocity=-1250.0,
        displacement_volts=0.5,
        velocity_volts=-0.25,
        desired_position=1.0,
        desired_velocity=2.0,
        desired_acceleration=3.0,
    )


def test_nothing_measured_and_nothing_desired():
    assert SensorScales(8.0, 5000.0).inputs(0, 0.0, 0.0, 0.0, 0.0, 0.0) == NO_INPUTS
