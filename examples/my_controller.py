"""Custom controller of docs/tutorial-own-controller.md."""

import dataclasses
import sys

from hdd_servo_ros.controllers import controller_main
from hdd_servo_ros.parameters import ParameterSet, parameter


@dataclasses.dataclass(frozen=True)
class MyParameters(ParameterSet):
    """Two feedback gains and a feedforward gain."""

    position_gain: float = parameter(0.5, 'feedback gain on the position error', unit='V/um', minimum=0.0)
    velocity_gain: float = parameter(9.7e-5, 'feedback gain on the velocity error', unit='V s/um', minimum=0.0)
    spring: float = parameter(0.0, 'feedforward gain on the reference', unit='V/um', minimum=0.0, maximum=0.1)


class MyController:
    """State feedback with feedforward of the pivot friction, which acts as a spring in small motions."""

    def __init__(self, parameters: MyParameters, sample_time: float) -> None:
        self.update(parameters)

    def update(self, parameters: MyParameters) -> None:
        """Use new parameters from the next tick on."""
        self.parameters = parameters

    def step(self, inputs):
        """Return the voltage to hold until the next tick."""
        p = self.parameters
        e, de = inputs.position - inputs.desired_position, inputs.velocity - inputs.desired_velocity
        return p.spring * inputs.desired_position - p.position_gain * e - p.velocity_gain * de


main = controller_main(MyController)
if __name__ == '__main__':
    sys.exit(main())
