"""Parameters of the disturbance generator, one group per source."""

import dataclasses

from hdd_servo_ros.disturbance.coupling import CouplingParameters
from hdd_servo_ros.disturbance.flutter import FlutterParameters
from hdd_servo_ros.disturbance.force_noise import ForceNoiseParameters
from hdd_servo_ros.disturbance.runout import RunoutParameters
from hdd_servo_ros.disturbance.shock import ShockParameters
from hdd_servo_ros.disturbance.spindle import SpindleParameters
from hdd_servo_ros.disturbance.vibration import BaseVibrationParameters
from hdd_servo_ros.parameters import ParameterSet, group


@dataclasses.dataclass(frozen=True)
class DisturbanceParameters(ParameterSet):
    """Parameters of :class:`~hdd_servo_ros.disturbance.generator.DisturbanceGenerator`; all sources default to off."""

    spindle: SpindleParameters = group(SpindleParameters)
    runout: RunoutParameters = group(RunoutParameters)
    flutter: FlutterParameters = group(FlutterParameters)
    force_noise: ForceNoiseParameters = group(ForceNoiseParameters)
    vibration: BaseVibrationParameters = group(BaseVibrationParameters)
    shock: ShockParameters = group(ShockParameters)
    coupling: CouplingParameters = group(CouplingParameters)

    @property
    def sources(self) -> dict[str, bool]:
        """Whether each source is enabled, by the name of its parameter group."""
        return {
            'runout.repeatable': self.runout.repeatable.enabled,
            'flutter': self.flutter.enabled,
            'force_noise': self.force_noise.enabled,
            'vibration.rotational': self.vibration.rotational.enabled,
            'vibration.linear': self.vibration.linear.enabled,
            'shock': self.shock.enabled,
        }

    @property
    def enabled_sources(self) -> tuple[str, ...]:
        """Names of the enabled sources."""
        return tuple(name for name, enabled in self.sources.items() if enabled)
