"""`servo_sensor`: head position decoded from the servo sectors of a drive."""

import sys
from collections.abc import Iterable, Sequence

from hdd_servo_ros.bench.servo_sensor import ServoSensor, ServoSensorParameters
from hdd_servo_ros.messages.cdr import VectorCodec, unpack_vector
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.nodes.saturation import SaturationLog
from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan

_HEAD, _DISTURBANCE = range(2)
"""Indices of the inputs; the second exists only in a run with a disturbance."""


class ServoSensorNode(CatalogNode):
    """Publisher of `/pes` for every `/head`, and `/disturbance` if the run has one."""

    def __init__(self) -> None:
        super().__init__('servo_sensor')
        self._codec = VectorCodec('')
        self._sensor = self.trial(ServoSensor, ServoSensorParameters)
        self._sensor.step(0, 0.0)
        self._saturation = SaturationLog(self)
        self._half_track = 0.0

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        self._sensor = ServoSensor(self.parameters[ServoSensorParameters], run.sample_time)
        self._half_track = 0.5 * self._sensor.parameters.track_pitch

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        track_center = unpack_vector(messages[_DISTURBANCE])[1] if len(messages) > _DISTURBANCE else 0.0
        error, position, sector = self._sensor.step(tick, unpack_vector(messages[_HEAD])[0], track_center)
        if not abs(error) < self._half_track:
            self._saturation.warn(self._sensor)
        message = self._codec.pack(stamp, error, position, sector)
        self.publish_vector(0, tick, message, error, position, sector)

    def update(self) -> None:
        self._sensor.update(self.parameters[ServoSensorParameters])
        self._half_track = 0.5 * self._sensor.parameters.track_pitch

    def diagnose(self) -> Iterable[Diagnosis]:
        yield self._saturation.diagnose(self._sensor, {'missing sectors in total': self._sensor.missing_sectors})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('servo_sensor', ServoSensorNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
