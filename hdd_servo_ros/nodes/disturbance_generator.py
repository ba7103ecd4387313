"""`disturbance_generator`: runout, flutter, force noise, vibration and shock of a drive in use."""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hdd_servo_ros.analysis.parameter_trial import Attempt, Sets, attempt_change
from hdd_servo_ros.disturbance.generator import DisturbanceGenerator
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.messages.cdr import AccelerationCodec, VectorCodec
from hdd_servo_ros.messages.errors import NotFiniteError
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.diagnosis import OK, WARN, Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan

_DEFAULT_SAMPLE_TIME = 1e-4


class DisturbanceGeneratorNode(CatalogNode):
    """Publisher of `/disturbance` and `/base_acceleration` for every tick of `/clock`."""

    def __init__(self) -> None:
        super().__init__('disturbance_generator')
        self._vectors = VectorCodec('')
        self._accelerations = AccelerationCodec('')
        # Compiles the kernel; the given parameters are checked when T of the run is known.
        self._generator = DisturbanceGenerator(DisturbanceParameters(), _DEFAULT_SAMPLE_TIME)
        self._generator.step(0)
        self._is_of_run = False
        self._largest_force = self._largest_displacement = 0.0

    def prepare(self, run: RunPlan) -> None:
        self._vectors = VectorCodec(run.frame_id)
        self._accelerations = AccelerationCodec(run.frame_id)
        self._generator = DisturbanceGenerator(self.parameters[DisturbanceParameters], run.sample_time)
        self._is_of_run = True

    def attempt(
        self, sets: Sets, sample_time: float, nodes: Mapping[str, Mapping[str, Any]], *, is_change: bool
    ) -> Attempt | None:
        if self._is_of_run:
            # A new generator would read its files again.
            return attempt_change(self.row_name, self._generator, is_change=is_change)
        return super().attempt(sets, sample_time, nodes, is_change=is_change)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        force, track_center, linear, angular = self._generator.step(tick)
        self._largest_force = max(self._largest_force, abs(force))
        self._largest_displacement = max(self._largest_displacement, abs(track_center))
        self.publish_vector(0, tick, self._vectors.pack(stamp, force, track_center, 0.0), force, track_center, 0.0)
        if not math.isfinite(sum(linear) + sum(angular)) and not all(map(math.isfinite, (*linear, *angular))):
            raise NotFiniteError(self.loop_publishers[1].topic_name, tick, (*linear, *angular), self.get_name())
        self.publish_bytes(1, self._accelerations.pack(stamp, linear, angular))

    def update(self) -> None:
        # Before the run, the block has the default parameters.
        if self._is_of_run:
            self._generator.update(self.parameters[DisturbanceParameters])

    def diagnose(self) -> Iterable[Diagnosis]:
        parameters: DisturbanceParameters = self.parameters[DisturbanceParameters]
        enabled = parameters.enabled_sources
        values = {
            'largest force since the last report [V]': self._largest_force,
            'largest displacement of the track center since the last report [um]': self._largest_displacement,
        }
        self._largest_force = self._largest_displacement = 0.0
        if enabled:
            yield Diagnosis('sources', OK, f'enabled: {", ".join(enabled)}', values)
        else:
            yield Diagnosis('sources', WARN, 'no source is enabled', values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('disturbance_generator', DisturbanceGeneratorNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
