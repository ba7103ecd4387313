"""A real controller node that does one thing wrong at tick 300, named by its parameter ``fault``."""

import dataclasses
import math
import sys
import time

from hdd_servo_ros.control.pid import Pid, PidParameters
from hdd_servo_ros.graph.catalog import register_controller
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters import parameter

AT = 300


@dataclasses.dataclass(frozen=True)
class FaultyParameters(PidParameters):
    fault: str = parameter(
        'not_finite', 'what to do wrong', choices=('not_finite', 'repeat', 'skip', 'exception', 'silence')
    )


class FaultyPid(Pid):
    parameters: FaultyParameters

    def step(self, inputs):
        u, unsaturated, feedback = super().step(inputs)
        if inputs.tick == AT:
            if self.parameters.fault == 'not_finite':
                return math.nan, unsaturated, feedback
            if self.parameters.fault == 'exception':
                return 1 / 0, unsaturated, feedback
            if self.parameters.fault == 'silence':
                time.sleep(3600.0)
        return u, unsaturated, feedback


class MisbehavingController(ControllerNode):
    def __init__(self):
        register_controller('misbehaving_controller', FaultyParameters, 'Does one thing wrong.')
        super().__init__('misbehaving_controller', FaultyPid)

    def step(self, tick, stamp, messages):
        fault = self.parameters[FaultyParameters].fault
        if tick == AT + 1 and fault == 'repeat':
            stamp = self._ticks.stamp(AT)
        if tick == AT + 1 and fault == 'skip':
            stamp = self._ticks.stamp(AT + 2)
        super().step(tick, stamp, messages)


def main():
    return run_node('pid_controller', MisbehavingController)


if __name__ == '__main__':
    sys.exit(main())
