"""A loop node from outside the package: 1 mV on /disturbance."""

import sys

from hdd_servo_ros.messages.cdr import VectorCodec
from hdd_servo_ros.messages.topics import CLOCK, DISTURBANCE
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.loop_node import Input, LoopNode


class Disturbance(LoopNode):
    def __init__(self):
        super().__init__('disturbance', [], [Input(CLOCK)], [DISTURBANCE])

    def prepare(self, run):
        self._codec = VectorCodec(run.frame_id)

    def step(self, tick, stamp, messages):
        self.publish_vector(0, tick, self._codec.pack(stamp, 1e-3, 0.0, 0.0), 1e-3, 0.0, 0.0)


if __name__ == '__main__':
    sys.exit(run_node('ldv_sensor', Disturbance))
