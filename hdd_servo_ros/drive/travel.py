"""
Travel limits of the drive: crash stops, off which the rigid body bounces.

A stop is an impact by Newton's law: at the instant of contact the velocity v turns into -e v, with the restitution e.
The instant is found inside of the substep, so that the body is never beyond a stop and no step size is too large. A
spring with damping would need its contact resolved, and a stiffness that nothing is known of.
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
"""What the plant's kernel knows of the stops."""

STOP_IMPACTS = layout('count', 'first_tick', 'largest_speed')
IMPACTS = layout(*((name, STOP_IMPACTS) for name in STOPS))
"""The impacts on each stop: how many, the tick by which the first one was, and the largest speed of impact [um/s]."""

_BISECTIONS = 52
"""As many as bring the instant of contact within rounding of a substep."""
_INSTANT = 1e-9
"""Part of a substep that is no time: the friction's steps divide by their length."""


@dataclass(frozen=True)
class TravelParameters(ParameterSet):
    """Crash stops of the rigid body; with both limits 0, the default, there are none."""

    lower: float = parameter(
        0.0, 'position of the lower crash stop; there are no stops if both limits are 0', unit='um', read_only=True
    )
    upper: float = parameter(
        0.0, 'position of the upper crash stop; there are no stops if both limits are 0', unit='um', read_only=True
    )
    restitution: float = parameter(
        0.4,
        'fraction of its speed with which the body bounces off a stop; below 0.5 for stops of soft plastic',
        minimum=0.0,
        maximum=1.0,
    )

    @property
    def is_limited(self) -> bool:
        """Whether there are stops."""
        return self.lower != 0.0 or self.upper != 0.0

    def check_together(self) -> None:
        """Check that the lower stop is below the upper one; raises :class:`ParameterError`."""
        if self.is_limited and not self.lower < self.upper:
            raise ParameterError('lower', self.lower, f'below the upper limit of {self.upper!r} um, or both 0')


@dataclass(frozen=True)
class StopImpacts:
    """
    The impacts on one stop.

    Attributes
    ----------
    count
        How many there were so far.
    first_tick
        The tick by which the first one was.
    largest_speed
        Largest speed of impact [um/s].
    """

    count: int
    first_tick: int
    largest_speed: float


def travel_constants(parameters: TravelParameters) -> Array:
    """Return the constants of the plant's kernel, of the layout :data:`TRAVEL`."""
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
    """Advance the free body; one function, since it is called from several places."""
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

    Up to the contact and after it the body moves by the friction's own step. A bounce that would be back at the stop
    within the substep is none: the body stays at rest there, and leaves in a later substep whose force pulls it away.
    The contact of the friction keeps its deflection in an impact.

    Parameters
    ----------
    travel
        Record of :data:`TRAVEL`, with stops.
    friction, nodes, substep, gain, position, velocity, deflection, mean_friction, applied, drag
        As of :func:`~hdd_servo_ros.drive.friction.dispatch.friction_substep`.

    Returns
    -------
    tuple
        Position [um], velocity [um/s] and deflection [um] at the end, mean friction [V]; time of the contact after the
        start [s]; the change of velocity that the stop makes then [um/s], 0 without contact; and the speed of impact
        with the sign of the stop [um/s], 0 for a body at rest on it.
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
        # It turns round within the substep, perhaps beyond the stop: look where it turns.
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
        # What the friction is after the impact predicts what it will be.
        mean_friction = friction_force(friction, nodes, limit, leaving, deflection, mean_friction)
        if left <= _INSTANT * substep:
            return limit, leaving, deflection, mean_friction, contact, leaving - arriving, speed * side
        x, v, z, f = _advance(friction, nodes, left, gain, limit, leaving, deflection, mean_friction, applied, drag)
        if (x - limit) * side < 0.0 and travel.lower <= x <= travel.upper:
            return x, v, z, f, contact, leaving - arriving, speed * side
    # A static friction balances what it can of the force, the stop the rest.
    mean_friction = friction_force(friction, nodes, limit, 0.0, deflection, applied)
    return limit, 0.0, deflection, mean_friction, contact, -arriving, speed * side


@compiled_apart
def count_impact(impacts: np.record, tick: int, speed: float) -> None:
    """Count an impact by ``tick`` on the stop whose sign its speed [um/s] has."""
    if speed > 0.0:
        stop = impacts.upper
    else:
        stop = impacts.lower
    if stop.count == 0.0:
        stop.first_tick = float(tick)
    stop.count += 1.0
    stop.largest_speed = max(stop.largest_speed, abs(speed))


@compiled_apart
def strike_modes(modes: Array, time: float, change: float, motion: Array) -> None:
    """Add what the modes do ``time`` [s] after a sudden change of the body's velocity [um/s]."""
    for i in range(len(motion)):
        mode = record(modes, MODE, i)
        decay = exp(-mode.half * time)
        sine, cosine = sine_cosine_of_turns(mode.damped * time / TWO_PI)
        moved = decay * sine / mode.damped
        motion[i, 0] += change * moved
        motion[i, 1] += change * (decay * cosine - mode.half * moved)
