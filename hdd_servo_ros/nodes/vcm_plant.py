"""`vcm_plant`: the drive."""

import math
import sys
from collections.abc import Iterable, Sequence

from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.messages.cdr import VectorCodec, unpack_vector
from hdd_servo_ros.messages.errors import NotFiniteError
from hdd_servo_ros.messages.topics import CONTROL_UPDATES, DISTURBANCE
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters.run_parameters import DriveIdentityParameters
from hdd_servo_ros.ros.diagnosis import OK, WARN, Diagnosis
from hdd_servo_ros.ros.publishers import publishers_of
from hdd_servo_ros.ros.run_plan import RunPlan


class VcmPlant(CatalogNode):
    """
    Publisher of `/head` for every tick of `/clock`, computed with `/control` of the previous tick.

    It warns of the first impact on each crash stop and counts all impacts.
    """

    def __init__(self) -> None:
        super().__init__('vcm_plant')
        self._codec = VectorCodec('')
        self._plant = self.trial(Plant, PlantParameters)
        self._plant.output()
        self._plant.step(1, 0.0, 0.0)
        self._disturbance = self._updates = 0
        self._is_limited = False
        self._warned: set[str] = set()
        self._diagnosed: dict[str, int] = {}

    def offers(self) -> dict[str, str]:
        drive = self.parameters[PlantParameters]
        return {
            'frame_id': self.parameters[DriveIdentityParameters].frame_id,
            'length_unit': drive.length_unit,
            'control_unit': drive.control_unit,
        }

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        ports = {port.topic.name: index for index, port in enumerate(self.inputs)}
        self._disturbance, self._updates = (ports.get(topic.name, 0) for topic in (DISTURBANCE, CONTROL_UPDATES))
        is_multirate = self._updates > 0
        self._plant = Plant(self.parameters[PlantParameters], run.sample_time, is_multirate=is_multirate)
        self._is_limited = self._plant.parameters.travel.is_limited
        for warning in self._plant.warnings():
            self.get_logger().warning(warning)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        if tick == 0:
            x, v, friction = self._plant.output()
        else:
            control, _, _ = self._voltages(1, tick, messages)
            disturbance = self._voltages(self._disturbance, tick, messages)[0] if self._disturbance else 0.0
            later = self._voltages(self._updates, tick, messages) if self._updates else None
            x, v, friction = self._plant.step(tick, control, disturbance, later)
            if self._is_limited:
                self._warn()
        self.publish_vector(0, tick, self._codec.pack(stamp, x, v, friction), x, v, friction)

    def _voltages(self, port: int, tick: int, messages: Sequence[bytes]) -> tuple[float, float, float]:
        x, y, z = unpack_vector(messages[port])
        if not math.isfinite(x + y + z) and not all(map(math.isfinite, (x, y, z))):
            topic = self.inputs[port].name
            raise NotFiniteError(topic, tick - 1, (x, y, z), publishers_of(self, topic))
        return x, y, z

    def _warn(self) -> None:
        for stop, warning in self._plant.impact_warnings().items():
            if stop not in self._warned:
                self._warned.add(stop)
                self.get_logger().warning(warning)

    def diagnose(self) -> Iterable[Diagnosis]:
        if not self._is_limited:
            return
        impacts = self._plant.impacts
        new = {stop: found.count - self._diagnosed.get(stop, 0) for stop, found in impacts.items()}
        self._diagnosed = {stop: found.count for stop, found in impacts.items()}
        values: dict[str, object] = {f'{stop} stop: impacts in total': found.count for stop, found in impacts.items()}
        unit = self._plant.parameters.length_unit
        values |= {f'{stop} stop: largest speed [{unit}/s]': found.largest_speed for stop, found in impacts.items()}
        hits = ', '.join(f'{stop} stop {count} times' for stop, count in new.items() if count)
        yield Diagnosis('travel', WARN if hits else OK, f'hit: {hits}' if hits else 'no new impacts', values)

    def update(self) -> None:
        self._plant.update(self.parameters[PlantParameters])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('vcm_plant', VcmPlant, arguments)


if __name__ == '__main__':
    sys.exit(main())
