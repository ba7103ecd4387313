"""How the base's acceleration becomes a force on the actuator: arm radius, imbalance, and a mount that may be hard."""

import dataclasses

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout
from hdd_servo_ros.parameters import ParameterSet, parameter

COUPLING = layout('rotational', 'linear', 'cubic', 'cubic_scale')

_UM_PER_M = 1e6


@dataclasses.dataclass(frozen=True)
class CouplingParameters(ParameterSet):
    """From the acceleration of the base to a force against u, referred to the control."""

    arm_radius: float = parameter(
        50.8e3,
        'distance R of the head from the pivot: a rotation of the base moves the track by R',
        unit='um',
        above=0.0,
    )
    imbalance: float = parameter(
        0.01,
        "part eta of the base's linear acceleration that the head takes relative to it: m e R/J of the actuator's "
        'imbalance',
    )
    gain: float = parameter(
        4.0968e7, 'acceleration of the head per volt, of the drive that is disturbed', unit='um/s^2/V', above=0.0
    )
    cubic: float = parameter(
        0.0, 'part by which a hard mount raises the force where it would be cubic_scale; 0 for a linear mount'
    )
    cubic_scale: float = parameter(0.031, 'force for which cubic is given', unit='V', above=0.0)


def fill_coupling(c: np.record, parameters: CouplingParameters) -> None:
    """Fill the constants of :func:`coupled_force`."""
    c.rotational = parameters.arm_radius / parameters.gain
    c.linear = parameters.imbalance * _UM_PER_M / parameters.gain
    c.cubic = parameters.cubic
    c.cubic_scale = parameters.cubic_scale


@compiled
def coupled_force(c: np.record, linear: float, angular: float) -> float:
    """Return the force against u [V] of a linear [m/s^2] and an angular acceleration [rad/s^2] of the base."""
    force: float = c.rotational * angular + c.linear * linear
    relative: float = force / c.cubic_scale
    hardening: float = c.cubic * relative * relative
    return force * (1.0 + hardening)
