import math

from hdd_servo_ros.control.open_loop import OpenLoop, OpenLoopParameters
from hdd_servo_ros.messages.controller_inputs import SensorScales

UNIT = SensorScales(1.0, 1.0)


def step(controller, tick, *signals):
    """Step with both outputs of the sensor, position and velocity at 1 um/V and 1 um/s/V, and the reference."""
    return controller.step(UNIT.inputs(tick, *signals))


def test_the_reference_is_the_voltage_within_the_limit():
    controller = OpenLoop(OpenLoopParameters(control_limit=2.0), 1e-4)
    assert step(controller, 3, 0.5, 0.5, 1.5, 9.0, 9.0) == (1.5, 1.5, 0.0)
    assert controller.estimates.tolist() == [3 * 1e-4]
    assert step(controller, 4, 0.0, 0.0, -3.0, 0.0, 0.0) == (-2.0, -3.0, 0.0)


def test_what_is_not_finite_is_not_hidden():
    controller = OpenLoop(OpenLoopParameters(), 1e-4)
    for inputs in ((math.nan, 0.0, 1.0, 0.0, 0.0), (0.0, math.inf, 1.0, 0.0, 0.0), (0.0, 0.0, math.inf, 0.0, 0.0)):
        assert math.isnan(step(controller, 0, *inputs)[0])


def test_update():
    controller = OpenLoop(OpenLoopParameters(), 1e-4)
    controller.update(OpenLoopParameters(control_limit=0.5))
    assert step(controller, 0, 0.0, 0.0, 1.0, 0.0, 0.0)[0] == 0.5


def test_the_limit_of_what_comes_behind():
    controller = OpenLoop(OpenLoopParameters(control_limit=0.5), 1e-4)
    controller.limit_output(0.25)
    assert step(controller, 0, 0.0, 0.0, 1.0, 0.0, 0.0) == (0.25, 1.0, 0.0)
    controller.limit_output(4.0)
    assert step(controller, 0, 0.0, 0.0, 1.0, 0.0, 0.0) == (0.5, 1.0, 0.0)
