"""
Number of integration substeps per sample that resolves the friction contact.

In presliding the friction contact is a spring on which the rigid body oscillates with the angular frequency
sqrt(gain stiffness). The integration is of second order, so its error grows with the square of the phase angle of this
oscillation per substep. For every model with a contact, a 100 Hz sine in presliding over 50 ms has these position
errors relative to the peak: at most 0.04 % at 0.024 rad per substep, up to 2 % at 0.24 rad (12 % with the tangential
stiffness, which has no damping), 43 % at 0.75 rad, and 4.2 times the peak at 2.4 rad. Where the contact breaks away
repeatedly, 0.05 rad still causes an error of 3 %.
"""

import math

from hdd_servo_ros.drive.friction.parameters import FrictionParameters

MODELS_WITH_CONTACT = ('tangential_stiffness', 'complete', 'dahl', 'lugre', 'lugre_position')
LARGEST_ANGLE = 0.3
"""Phase angle of the contact oscillation per substep above which a warning is logged [rad]."""
CHOSEN_ANGLE = 0.03
"""Largest phase angle per substep with ``substeps: 0`` [rad]."""
LEAST_SUBSTEPS, MOST_SUBSTEPS = 4, 1024
"""Bounds of the number of substeps with ``substeps: 0``."""


def contact_frequency(gain: float, friction: FrictionParameters) -> float:
    """
    Return the angular frequency of the rigid body on the friction contact [rad/s], or 0 without a contact.

    Parameters
    ----------
    gain
        Acceleration of the rigid body per volt [um/s^2/V].
    friction
        Parameters of the friction.
    """
    return math.sqrt(gain * friction.stiffness) if friction.model in MODELS_WITH_CONTACT else 0.0


def needed_substeps(frequency: float, sample_time: float) -> int:
    """Return the substeps per sample time [s] that a contact frequency [rad/s] needs, within the bounds."""
    needed = frequency * sample_time / CHOSEN_ANGLE
    return LEAST_SUBSTEPS if needed <= LEAST_SUBSTEPS else min(math.ceil(min(needed, MOST_SUBSTEPS)), MOST_SUBSTEPS)


def contact_warning(frequency: float, sample_time: float, substeps: int) -> str:
    """
    Return a warning if the substeps do not resolve the friction contact, or an empty string.

    Parameters
    ----------
    frequency
        Angular frequency of the contact [rad/s].
    sample_time
        T [s].
    substeps
        Integration substeps per sample.
    """
    angle = frequency * sample_time / substeps
    if angle <= LARGEST_ANGLE:
        return ''
    wanted = frequency * sample_time / CHOSEN_ANGLE
    cure = (
        f'set substeps to {needed_substeps(frequency, sample_time)}, or to 0 for an automatic choice'
        if wanted <= MOST_SUBSTEPS
        else f'even {MOST_SUBSTEPS} substeps do not resolve it to {CHOSEN_ANGLE:g} rad; reduce sample_time'
    )
    return (
        'friction contact not resolved: its frequency sqrt(gain * friction.stiffness) = '
        f'{frequency / (2.0 * math.pi):.4g} Hz turns by {angle:.3g} rad per substep (limit {LARGEST_ANGLE:g}), '
        f'so the position error is several percent or more; {cure}'
    )
