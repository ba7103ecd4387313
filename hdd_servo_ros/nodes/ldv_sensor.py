"""`ldv_sensor`: laser Doppler vibrometer."""

import sys
from collections.abc import Iterable, Sequence

from hdd_servo_ros.bench.ldv import Ldv, LdvParameters
from hdd_servo_ros.messages.cdr import VectorCodec, unpack_vector
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.nodes.saturation import SaturationLog
from hdd_servo_ros.ros.diagnosis import Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan


class LdvSensor(CatalogNode):
    """Publisher of `/ldv` for every `/head`; it warns once per saturated output."""

    def __init__(self) -> None:
        super().__init__('ldv_sensor')
        self._codec = VectorCodec('')
        self._ldv = self.trial(Ldv, LdvParameters)
        self._ldv.step(0, 0.0, 0.0)
        self._lowest, self._highest = self._ldv.parameters.levels()
        self._saturation = SaturationLog(self)

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        self._ldv = Ldv(self.parameters[LdvParameters], run.sample_time)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        position, velocity, _ = unpack_vector(messages[0])
        x, v = self._ldv.step(tick, position, velocity)
        lowest, highest = self._lowest, self._highest
        if not (lowest < x < highest and lowest < v < highest):
            self._saturation.warn(self._ldv)
        self.publish_vector(0, tick, self._codec.pack(stamp, x, v, 0.0), x, v, 0.0)

    def diagnose(self) -> Iterable[Diagnosis]:
        yield self._saturation.diagnose(self._ldv, {'dropped samples in total': self._ldv.dropped_samples})

    def update(self) -> None:
        self._ldv.update(self.parameters[LdvParameters])
        self._lowest, self._highest = self._ldv.parameters.levels()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('ldv_sensor', LdvSensor, arguments)


if __name__ == '__main__':
    sys.exit(main())
