"""Parameters of the disturbance generator: a group for each source."""

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
    """Parameters of :class:`~hdd_servo_ros.disturbance.generator.DisturbanceGenerator`; no source is on by default."""

    spindle: SpindleParameters = group(SpindleParameters)
    runout: RunoutParameters = group(RunoutParameters)
    flutter: FlutterParameters = group(FlutterParameters)
    force_noise: ForceNoiseParameters = group(ForceNoiseParameters)
    vibration: BaseVibrationParameters = group(BaseVibrationParameters)
    shock: ShockParameters = group(ShockParameters)
    coupling: CouplingParameters = group(CouplingParameters)

    @property
    def sources(self) -> dict[str, bool]:
        """Whether each source is on, by its name, which is that of its parameters."""
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
        """Names of the sources that are on."""
        return tuple(name for name, enabled in self.sources.items() if enabled)
