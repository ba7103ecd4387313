"""Coupling of the base acceleration to the actuator: arm radius, actuator imbalance, hardening mount."""

import dataclasses

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterSet, parameter

COUPLING = layout('rotational', 'linear', 'cubic', 'cubic_scale')

_UM_PER_M = 1e6


@dataclasses.dataclass(frozen=True)
class CouplingParameters(ParameterSet):
    """Coupling of the base acceleration to a force against u, referred to the control voltage."""

    arm_radius: float = parameter(
        50.8e3,
        'arm radius R: distance from pivot to head, 2 inches; a base rotation by an angle moves the track by R times '
        'the angle; independent of actuator.arm_length of vcm_plant, which the default driver does not use',
        unit='um',
        above=0.0,
    )
    imbalance: float = parameter(
        0.01,
        'imbalance coefficient eta = m e R/J of the actuator: head acceleration relative to the base, divided by the '
        'linear base acceleration',
    )
    gain: float = parameter(4.0968e7, 'head acceleration per volt of the disturbed drive', unit='um/s^2/V', above=0.0)
    cubic: float = parameter(
        0.0, 'relative increase of the force by a hardening mount at cubic_scale; 0 for a linear mount'
    )
    cubic_scale: float = parameter(
        0.031, 'force F_0 at which a hardening mount increases the force by the fraction cubic', unit='V', above=0.0
    )


def fill_coupling(c: np.record, parameters: CouplingParameters) -> None:
    """Fill the constants of :func:`coupled_force`."""
    c.rotational = parameters.arm_radius / parameters.gain
    c.linear = parameters.imbalance * _UM_PER_M / parameters.gain
    c.cubic = parameters.cubic
    c.cubic_scale = parameters.cubic_scale


@compiled
def coupled_force(c: np.record, linear: float, angular: float) -> float:
    """Return the force against u [V] caused by a linear [m/s^2] and an angular [rad/s^2] acceleration of the base."""
    force: float = c.rotational * angular + c.linear * linear
    relative: float = force / c.cubic_scale
    hardening: float = c.cubic * relative * relative
    return force * (1.0 + hardening)
