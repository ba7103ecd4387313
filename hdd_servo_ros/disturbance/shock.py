"""
Shocks: half-sine, sawtooth and trapezoidal pulses of the base acceleration.

The value held over a sample is the mean of the pulse over that sample, so the velocity change of a shock is correct at
any sample time.
"""

import dataclasses
from enum import IntEnum

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

STANDARD_GRAVITY = 9.80665
"""1 g [m/s^2]."""
RISE = 0.1
"""Rise time and fall time of a trapezoidal pulse, as a fraction of its duration."""


class Shape(IntEnum):
    """Pulse shapes, numbered for compiled code."""

    HALF_SINE = 0
    SAW_TOOTH = 1
    TRAPEZOID = 2


SHAPES = tuple(shape.name.lower() for shape in Shape)

SHOCK = layout('is_enabled', 'pulse', 'time_step', 'time', 'duration', 'period', 'linear', 'rotational')


_SHORTEST_PERIOD = 1e-4
"""Shortest period of repeated pulses [s], because all pulses within a tick are summed."""


@dataclasses.dataclass(frozen=True)
class ShockParameters(ParameterSet):
    """Single or repeated shock: a pulse of the linear acceleration, the rotational acceleration, or both."""

    enabled: bool = parameter(False, 'enable the shocks')
    shape: str = parameter(
        'half_sine',
        'pulse shape; a sawtooth ends at its peak, a trapezoid has rise and fall times of a tenth of the duration',
        choices=SHAPES,
    )
    linear_amplitude: float = parameter(63.0, 'peak linear acceleration along the head motion', unit='g')
    rotational_amplitude: float = parameter(0.0, 'peak rotational acceleration about the pivot axis', unit='rad/s^2')
    duration: float = parameter(2e-3, 'duration of the pulse', unit='s', above=0.0)
    time: float = parameter(0.1, 'start time of the first pulse', unit='s', minimum=0.0)
    period: float = parameter(0.0, 'period of repeated pulses; 0 for a single pulse', unit='s', minimum=0.0)

    def check_together(self) -> None:
        """Reject overlapping pulses, and pulse trains too fast for any practical sampling rate."""
        if 0.0 < self.period < _SHORTEST_PERIOD:
            raise ParameterError('period', self.period, f'0, or at least {_SHORTEST_PERIOD:g} [s]')
        if 0.0 < self.period < self.duration:
            raise ParameterError('period', self.period, f'0, or at least duration, which is {self.duration!r} [s]')


@compiled_apart
def _impulse(shape: int, t: float, duration: float) -> float:
    """Return the time integral of a pulse of height 1, from its start to ``t`` [s]."""
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
    # (1 - cos(pi t/D)) D/pi, without cancellation.
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
        # Include all pulses up to the last one that has started: a sample may be longer than a period.
        first = np.floor(max(begin, 0.0) / period)
        count = int(np.floor(end / period) - first) + 1
    total = 0.0
    for i in range(count):
        start = (first + float(i)) * period
        total += _impulse(shape, end - start, duration) - _impulse(shape, begin - start, duration)
    return total / time_step
