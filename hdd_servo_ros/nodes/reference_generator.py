"""`reference_generator`: desired position and its first two derivatives."""

import sys
from collections.abc import Sequence

from hdd_servo_ros.messages.cdr import VectorCodec
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.run_plan import RunPlan
from hdd_servo_ros.signals.reference import Reference, ReferenceParameters


class ReferenceGenerator(CatalogNode):
    """Publisher of `/reference` for every tick of `/clock`."""

    def __init__(self) -> None:
        super().__init__('reference_generator')
        self._codec = VectorCodec('')
        self._reference = self.trial(Reference, ReferenceParameters)
        self._reference.step(0)

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        self._reference = Reference(self.parameters[ReferenceParameters], run.sample_time)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        x, v, a = self._reference.step(tick)
        self.publish_vector(0, tick, self._codec.pack(stamp, x, v, a), x, v, a)

    def update(self) -> None:
        self._reference.update(self.parameters[ReferenceParameters])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('reference_generator', ReferenceGenerator, arguments)


if __name__ == '__main__':
    sys.exit(main())
