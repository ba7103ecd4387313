"""A controller that seeks along a trajectory of its own, and reports its modes as a seek controller does."""

import dataclasses
import sys

from hdd_servo_ros import Run
from hdd_servo_ros.analysis.seek_metrics import FOLLOW, SEEK, SETTLE
from hdd_servo_ros.parameters import ParameterSet, parameter

GAIN = 4.0968e7


@dataclasses.dataclass(frozen=True)
class SeekerParameters(ParameterSet):
    """Acceleration of the trajectory, and whether it reports what it does."""

    acceleration: float = parameter(2e8, 'mean acceleration of the trajectory', unit='um/s^2', above=0.0)
    flutters: bool = parameter(False, 'whether it settles once more after it has settled')
    position_gain: float = parameter(0.6, 'voltage per position error', unit='V/um', minimum=0.0)


class Seeker:
    """A minimum-jerk trajectory from jump to jump of the reference, with PID about it."""

    estimate_names = ('seek_mode', 'seek_target', 'seek_distance', 'seek_time')

    def __init__(self, parameters: SeekerParameters, sample_time: float) -> None:
        self.parameters, self.sample_time = parameters, sample_time
        self.estimates = [0.0] * 4
        self.origin = self.target = self.integral = 0.0
        self.samples, self.elapsed, self.mode, self.inside = 1, 1, FOLLOW, 0

    def update(self, parameters: SeekerParameters) -> None:
        """Take other parameters."""
        self.parameters = parameters

    def step(self, inputs):
        """Return the voltage."""
        p, t = self.parameters, self.sample_time
        if inputs.desired_position != self.target:
            self.origin, self.target = self.target, inputs.desired_position
            length = abs(self.target - self.origin)
            self.samples, self.elapsed = max(8, int((6.0 * length / p.acceleration) ** 0.5 / t)), 0
            self.mode, self.inside = SEEK, 0
        elif self.elapsed < self.samples:
            self.elapsed += 1
        s, length, duration = self.elapsed / self.samples, self.target - self.origin, self.samples * t
        x = self.origin + length * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        v = length * 30.0 * s**2 * (1.0 - s) ** 2 / duration
        a = length * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration**2
        self.inside = self.inside + 1 if abs(inputs.position - self.target) < 0.1 else 0
        if self.mode == SEEK and self.elapsed == self.samples:
            self.mode, self.inside = SETTLE, 0
        elif self.mode == SETTLE and self.inside >= 4:
            self.mode = FOLLOW
        elif p.flutters and self.inside == 30:
            self.mode = SETTLE
        e, de = inputs.position - x, inputs.velocity - v
        self.integral = 0.0 if self.mode == SEEK else self.integral + t * e
        self.estimates = [float(self.mode), self.target, self.target - inputs.position, 0.0]
        return a / GAIN + 4.6e-6 * v - p.position_gain * e - 1.4e-4 * de - 62.0 * self.integral


TARGETS = (10.0, 0.0, 50.0, 49.0, -20.0, 0.0)
SCALES = ('ldv_sensor:velocity_scale:=100000.0', 'ldv_sensor:displacement_scale:=30.0')


def seeking_run(simulated, directory, *arguments):
    """Record steps to :data:`TARGETS`, 20 ms apart from tick 0 on, by :class:`Seeker` unless told otherwise."""
    given = (
        'controller:=hdd_seeker:Seeker',
        'waveform:=seek',
        'seek.trajectory:=step',
        f'seek.targets:={list(TARGETS)}',
        'seek.dwell_times:=[0.02]',
        'seek.repeat:=false',
        'duration:=0.12',
        *SCALES,
        *arguments,
    )
    # As a module that Python finds by its name.
    sys.modules['hdd_seeker'] = sys.modules[__name__]
    return Run.open(simulated(directory, *(part for text in given for part in ('-p', text))))
