"""
Shocks: half-sine, saw-tooth and trapezoidal pulses of the base's acceleration.

What is held over a sample is the mean of the pulse over that sample, so that the velocity that a shock leaves behind is
right at every sample time.
"""

import dataclasses
from enum import IntEnum

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

STANDARD_GRAVITY = 9.80665
"""1 G [m/s^2]."""
RISE = 0.1
"""Part of its duration in which a trapezoidal pulse rises, and in which it falls."""


class Shape(IntEnum):
    """The shapes by the number that compiled code knows them by."""

    HALF_SINE = 0
    SAW_TOOTH = 1
    TRAPEZOID = 2


SHAPES = tuple(shape.name.lower() for shape in Shape)

SHOCK = layout('is_enabled', 'pulse', 'time_step', 'time', 'duration', 'period', 'linear', 'rotational')


_SHORTEST_PERIOD = 1e-4
"""Of repeated pulses [s]: all that fall into a tick are summed."""


@dataclasses.dataclass(frozen=True)
class ShockParameters(ParameterSet):
    """A shock, once or repeated: a pulse of the linear acceleration, of the rotational one, or of both."""

    enabled: bool = parameter(False, 'whether there are shocks')
    shape: str = parameter(
        'half_sine',
        'shape of the pulse; a saw-tooth ends with its peak, a trapezoid rises and falls in a tenth of its duration '
        'each',
        choices=SHAPES,
    )
    linear_amplitude: float = parameter(63.0, "peak linear acceleration along the head's motion", unit='G')
    rotational_amplitude: float = parameter(0.0, 'peak rotational acceleration about the pivot axis', unit='rad/s^2')
    duration: float = parameter(2e-3, 'duration of the pulse', unit='s', above=0.0)
    time: float = parameter(0.1, 'time at which the first pulse begins', unit='s', minimum=0.0)
    period: float = parameter(0.0, 'time from one pulse to the next; 0 for a single one', unit='s', minimum=0.0)

    def check_together(self) -> None:
        """Reject pulses that overlap, and trains of pulses that no sampling frequency could show."""
        if 0.0 < self.period < _SHORTEST_PERIOD:
            raise ParameterError('period', self.period, f'0, or at least {_SHORTEST_PERIOD:g} s [s]')
        if 0.0 < self.period < self.duration:
            raise ParameterError('period', self.period, f'0, or at least the duration of {self.duration!r} s [s]')


@compiled_apart
def _impulse(shape: int, t: float, duration: float) -> float:
    """Return the integral over time of a pulse of height 1, from its beginning to ``t`` [s]."""
    t = min(max(t, 0.0), duration)
    if shape == Shape.SAW_TOOTH:
        return 0.5 * t * t / duration
    if shape == Shape.TRAPEZOID:
        rise = RISE * duration
        if t <= rise:
            return 0.5 * t * t / rise
        if t <= duration - rise:
            return t - 0.5 * rise
        left = duration - t
        return duration - rise - 0.5 * left * left / rise
    # (1 - cos(pi t/D)) D/pi, without the difference of two numbers close to 1.
    sine, _ = sine_cosine_of_turns(0.25 * t / duration)
    return 4.0 * duration / TWO_PI * sine * sine


@compiled
def shock_mean(c: np.record, tick: int) -> float:
    """Return the mean over the sample after a tick of pulses of height 1."""
    shape = int(c.pulse)
    duration, period, time_step = float(c.duration), float(c.period), float(c.time_step)
    begin = float(tick) * time_step - c.time
    end = float(tick + 1) * time_step - c.time
    if end <= 0.0 or (period <= 0.0 and begin >= duration):
        return 0.0
    first, count = 0.0, 1
    if period > 0.0:
        # Up to the last pulse that has begun, since a sample may be longer than a period.
        first = np.floor(max(begin, 0.0) / period)
        count = int(np.floor(end / period) - first) + 1
    total = 0.0
    for i in range(count):
        start = (first + float(i)) * period
        total += _impulse(shape, end - start, duration) - _impulse(shape, begin - start, duration)
    return total / time_step
