"""
Travel limits of the drive: crash stops that the rigid body bounces off.

An impact on a stop follows Newton's law of restitution: at the instant of contact the velocity v becomes -e v, where e
is the coefficient of restitution. The instant is located within the substep, so the body never passes a stop and any
step size is valid. A spring-damper stop would have to be resolved in time, and its stiffness is unknown.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.friction.dispatch import friction_force, friction_substep
from hdd_servo_ros.drive.resonance import MODE
from hdd_servo_ros.numerics.compiled import compiled_apart
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

Array = npt.NDArray[np.float64]

STOPS = ('lower', 'upper')

TRAVEL = layout('is_limited', 'lower', 'upper', 'restitution')
"""Constants of the crash stops in the plant kernel."""

STOP_IMPACTS = layout('count', 'first_tick', 'largest_speed')
IMPACTS = layout(*((name, STOP_IMPACTS) for name in STOPS))
"""Impacts on each stop: their number, the tick by which the first one occurred, and the largest impact speed [um/s]."""

_BISECTIONS = 52
"""Number of bisections that locate the instant of contact in a substep to rounding precision."""
_INSTANT = 1e-9
"""Fraction of a substep below which a duration counts as zero, because the friction steps divide by their length."""


@dataclass(frozen=True)
class TravelParameters(ParameterSet):
    """Crash stops of the rigid body; disabled if both limits are 0 (the default)."""

    lower: float = parameter(
        0.0, 'position of the lower crash stop; the stops are disabled if both are 0', unit='um', read_only=True
    )
    upper: float = parameter(
        0.0, 'position of the upper crash stop; the stops are disabled if both are 0', unit='um', read_only=True
    )
    restitution: float = parameter(
        0.4,
        'coefficient of restitution e of the crash stops: rebound speed over impact speed; below 0.5 for soft plastic',
        minimum=0.0,
        maximum=1.0,
    )

    @property
    def is_limited(self) -> bool:
        """Whether the crash stops are enabled."""
        return self.lower != 0.0 or self.upper != 0.0

    def check_together(self) -> None:
        """Check that the lower stop is below the upper stop; raise :class:`ParameterError` otherwise."""
        if self.is_limited and not self.lower < self.upper:
            raise ParameterError(
                'lower', self.lower, f'a value below travel.upper, which is {self.upper!r} um, or both 0'
            )


@dataclass(frozen=True)
class StopImpacts:
    """
    Impacts on one crash stop.

    Attributes
    ----------
    count
        Number of impacts so far.
    first_tick
        Tick by which the first impact occurred.
    largest_speed
        Largest impact speed [um/s].
    """

    count: int
    first_tick: int
    largest_speed: float


def travel_constants(parameters: TravelParameters) -> Array:
    """Return the crash-stop constants of the plant kernel, in the layout :data:`TRAVEL`."""
    constants = zeros(TRAVEL)
    c = record(constants, TRAVEL)
    c.is_limited = float(parameters.is_limited)
    c.lower, c.upper, c.restitution = parameters.lower, parameters.upper, parameters.restitution
    return constants


@compiled_apart
def _advance(
    friction: np.record,
    nodes: Array,
    time: float,
    gain: float,
    position: float,
    velocity: float,
    deflection: float,
    mean_friction: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float, float]:
    """Advance the free body; not inlined, because it is called five times."""
    return friction_substep(friction, nodes, time, gain, position, velocity, deflection, mean_friction, applied, drag)


@compiled_apart
def travel_substep(
    travel: np.record,
    friction: np.record,
    nodes: Array,
    substep: float,
    gain: float,
    position: float,
    velocity: float,
    deflection: float,
    mean_friction: float,
    applied: float,
    drag: float,
) -> tuple[float, float, float, float, float, float, float]:
    """
    Advance a rigid body with friction between stops by one substep.

    Before and after the impact the body moves by the friction step. If a bounce would return to the stop within the
    substep, the body stays at rest on the stop instead, and leaves it in a later substep when the force pulls it away.
    The friction contact keeps its deflection during an impact.

    Parameters
    ----------
    travel
        Record with the layout :data:`TRAVEL`, with the stops enabled.
    friction, nodes, substep, gain, position, velocity, deflection, mean_friction, applied, drag
        See :func:`~hdd_servo_ros.drive.friction.dispatch.friction_substep`.

    Returns
    -------
    tuple
        Position [um], velocity [um/s] and deflection [um] at the end; mean friction [V]; time of the impact after the
        start [s]; velocity change caused by the stop [um/s], 0 without contact; impact speed with the sign of the stop
        [um/s], 0 for a body at rest on it.
    """
    end, end_velocity, end_deflection, end_friction = _advance(
        friction, nodes, substep, gain, position, velocity, deflection, mean_friction, applied, drag
    )
    late = substep
    if end > travel.upper:
        side, limit = 1.0, travel.upper
    elif end < travel.lower:
        side, limit = -1.0, travel.lower
    else:
        side = 1.0 if velocity > 0.0 else -1.0
        limit = travel.upper if velocity > 0.0 else travel.lower
        reaches = (position + substep * velocity - limit) * side > 0.0
        if not reaches or end_velocity * side >= 0.0:
            return end, end_velocity, end_deflection, end_friction, 0.0, 0.0, 0.0
        # The body reverses within the substep, perhaps beyond the stop: find the turning point.
        early = 0.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (early + late)
            _, v, _, _ = _advance(
                friction, nodes, middle, gain, position, velocity, deflection, mean_friction, applied, drag
            )
            if v * side > 0.0:
                early = middle
            else:
                late = middle
        x, _, _, _ = _advance(friction, nodes, late, gain, position, velocity, deflection, mean_friction, applied, drag)
        if (x - limit) * side <= 0.0:
            return end, end_velocity, end_deflection, end_friction, 0.0, 0.0, 0.0
    contact = 0.0
    if (position - limit) * side < 0.0 or velocity * side < 0.0:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (contact + late)
            x, _, _, _ = _advance(
                friction, nodes, middle, gain, position, velocity, deflection, mean_friction, applied, drag
            )
            if (x - limit) * side > 0.0:
                late = middle
            else:
                contact = middle
    arriving = velocity
    if contact > _INSTANT * substep:
        _, arriving, deflection, mean_friction = _advance(
            friction, nodes, contact, gain, position, velocity, deflection, mean_friction, applied, drag
        )
    speed = max(arriving * side, 0.0)
    leaving = -travel.restitution * speed * side
    left = substep - contact
    if leaving != 0.0:
        # The friction just after the impact is the prediction for the rest of the substep.
        mean_friction = friction_force(friction, nodes, limit, leaving, deflection, mean_friction)
        if left <= _INSTANT * substep:
            return limit, leaving, deflection, mean_friction, contact, leaving - arriving, speed * side
        x, v, z, f = _advance(friction, nodes, left, gain, limit, leaving, deflection, mean_friction, applied, drag)
        if (x - limit) * side < 0.0 and travel.lower <= x <= travel.upper:
            return x, v, z, f, contact, leaving - arriving, speed * side
    # Static friction balances the applied force up to its limit; the stop carries the rest.
    mean_friction = friction_force(friction, nodes, limit, 0.0, deflection, applied)
    return limit, 0.0, deflection, mean_friction, contact, -arriving, speed * side


@compiled_apart
def count_impact(impacts: np.record, tick: int, speed: float) -> None:
    """Count an impact by ``tick``; the sign of ``speed`` [um/s] selects the stop."""
    if speed > 0.0:
        stop = impacts.upper
    else:
        stop = impacts.lower
    if stop.count == 0.0:
        stop.first_tick = float(tick)
    stop.count += 1.0
    stop.largest_speed = max(stop.largest_speed, abs(speed))


@compiled_apart
def excite_modes(modes: Array, time: float, change: float, motion: Array) -> None:
    """Add the response of the modes ``time`` [s] after a velocity step ``change`` of the rigid body [um/s]."""
    for i in range(len(motion)):
        mode = record(modes, MODE, i)
        decay = exp(-mode.half * time)
        sine, cosine = sine_cosine_of_turns(mode.damped * time / TWO_PI)
        moved = decay * sine / mode.damped
        motion[i, 0] += change * moved
        motion[i, 1] += change * (decay * cosine - mode.half * moved)
