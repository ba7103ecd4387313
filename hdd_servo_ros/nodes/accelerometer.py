"""`accelerometer`: two accelerometers on the base of the drive."""

import sys
from collections.abc import Iterable, Sequence

from hdd_servo_ros.bench.accelerometer import Accelerometer, AccelerometerParameters
from hdd_servo_ros.messages.cdr import VectorCodec, unpack_accelerations, unpack_vector
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.nodes.saturation import SaturationLog
from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan

_CONTROL, _BASE = range(2)
"""Indices of the inputs; the second exists only in a run whose disturbance moves the base."""


class AccelerometerNode(CatalogNode):
    """Publisher of `/accelerometer` for every tick, from base acceleration and control since the last one."""

    def __init__(self) -> None:
        super().__init__('accelerometer')
        self._codec = VectorCodec('')
        self._sensors = self.trial(Accelerometer, AccelerometerParameters)
        self._sensors.step(0, 0.0, 0.0, 0.0)
        self._saturation = SaturationLog(self)
        self._limit = 0.0

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        self._sensors = Accelerometer(self.parameters[AccelerometerParameters], run.sample_time)
        self._limit = self._sensors.largest_output

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        linear = angular = control = 0.0
        if tick > 0:
            control = unpack_vector(messages[_CONTROL])[0]
            if len(messages) > _BASE:
                _, linear, _, _, _, angular = unpack_accelerations(messages[_BASE])
        x, y = self._sensors.step(tick, linear, angular, control)
        if not (abs(x) < self._limit and abs(y) < self._limit):
            self._saturation.warn(self._sensors)
        self.publish_vector(0, tick, self._codec.pack(stamp, x, y, 0.0), x, y, 0.0)

    def update(self) -> None:
        self._sensors.update(self.parameters[AccelerometerParameters])
        self._limit = self._sensors.largest_output

    def diagnose(self) -> Iterable[Diagnosis]:
        yield self._saturation.diagnose(self._sensors, {})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('accelerometer', AccelerometerNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
