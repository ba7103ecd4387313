"""Publish a force of a few millivolts on /disturbance, a different one at every tick."""

import sys

from hdd_servo_ros.messages.cdr import VectorCodec
from hdd_servo_ros.messages.topics import CLOCK, DISTURBANCE
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.loop_node import LoopNode


class Disturbance(LoopNode):
    """Loop node that publishes a force against u [V] at every tick of /clock."""

    def __init__(self):
        super().__init__('disturbance', [], [Input(CLOCK)], [DISTURBANCE])

    def prepare(self, run):
        """Prepare for a run; called before tick 0."""
        self._codec = VectorCodec('shaker')

    def step(self, tick, stamp, messages):
        """Publish the force of one tick."""
        force = 1e-3 * (1 + 37 * tick % 11)
        self.publish_vector(0, tick, self._codec.pack(stamp, force, 0.0, 0.0), force, 0.0, 0.0)


if __name__ == '__main__':
    sys.exit(run_node('ldv_sensor', Disturbance))
