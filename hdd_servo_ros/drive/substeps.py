"""
How many integration steps a sample needs, so that the contact of the friction is resolved.

In presliding the contact is a spring: the rigid body swings on it with the angular frequency sqrt(gain stiffness). The
integration is of second order, so that its error grows with the square of that mode's angle in a substep. Over 50 ms
of a 100 Hz sine in presliding the error of the position is, for every model with a contact, at most 0.04 % of its peak
at 0.024 rad, and up to 2 % (with the tangential stiffness, which has no damping, 12 %) at 0.24 rad, 43 % at 0.75 rad
and 4.2 times the peak at 2.4 rad. Where the contact breaks away again and again, 0.05 rad still cost 3 %.
"""

import math

from hdd_servo_ros.drive.friction.parameters import FrictionParameters

MODELS_WITH_CONTACT = ('tangential_stiffness', 'complete', 'dahl', 'lugre', 'lugre_position')
LARGEST_ANGLE = 0.3
"""Angle of the contact's mode in a substep above which a user is warned [rad]."""
CHOSEN_ANGLE = 0.03
"""Largest angle with as many substeps as ``substeps: 0`` chooses [rad]."""
LEAST_SUBSTEPS, MOST_SUBSTEPS = 4, 1024
"""Bounds of that choice."""


def contact_frequency(gain: float, friction: FrictionParameters) -> float:
    """
    Return the angular frequency of the rigid body on the contact of the friction [rad/s], 0 without a contact.

    Parameters
    ----------
    gain
        Acceleration of the rigid body per volt [um/s^2/V].
    friction
        The friction.
    """
    return math.sqrt(gain * friction.stiffness) if friction.model in MODELS_WITH_CONTACT else 0.0


def needed_substeps(frequency: float, sample_time: float) -> int:
    """Return how many substeps a contact's angular frequency [rad/s] needs at a sample time [s], within the bounds."""
    needed = frequency * sample_time / CHOSEN_ANGLE
    return LEAST_SUBSTEPS if needed <= LEAST_SUBSTEPS else min(math.ceil(min(needed, MOST_SUBSTEPS)), MOST_SUBSTEPS)


def contact_warning(frequency: float, sample_time: float, substeps: int) -> str:
    """
    Return what a user should be told of a contact that the substeps do not resolve; empty if they do.

    Parameters
    ----------
    frequency
        Of the contact [rad/s].
    sample_time
        T [s].
    substeps
        Integration steps a sample.
    """
    angle = frequency * sample_time / substeps
    if angle <= LARGEST_ANGLE:
        return ''
    wanted = frequency * sample_time / CHOSEN_ANGLE
    cure = (
        f'give substeps = {needed_substeps(frequency, sample_time)}, or 0, which chooses them'
        if wanted <= MOST_SUBSTEPS
        else f'even {MOST_SUBSTEPS} substeps do not resolve it to {CHOSEN_ANGLE:g} rad: give a smaller sample_time'
    )
    return (
        f'contact not resolved: sqrt(gain friction.stiffness) = {frequency / (2.0 * math.pi):.4g} Hz turns by '
        f'{angle:.3g} rad in a substep, above {LARGEST_ANGLE:g}, and the position is wrong by per cents or more; {cure}'
    )
