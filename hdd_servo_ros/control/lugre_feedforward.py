"""LuGre friction, thesis eqs. (2.20)-(2.22), of a known motion, for use as a feedforward."""

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled_apart
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.numerics.records import layout

BRISTLE = layout('stiffness', 'bristle_damping', 'coulomb_level', 'static_level', 'inverse_stribeck_velocity')
"""sigma_0 [V/um], sigma_1 [V s/um], f_c and f_s [V], 1/v_s [s/um]."""

SUBSTEPS = 4
"""Substeps per sample; the velocity is constant in each, so that the solution of the bristle equation is exact."""


@compiled_apart
def mean_friction(
    c: np.record, deflection: float, time_step: float, rise: float, first_velocity: float, last_velocity: float
) -> tuple[float, float]:
    """
    Return the mean friction [V] over a sample without its viscous part, and the bristle deflection [um] at its end.

    Parameters
    ----------
    c
        Record of ``BRISTLE``.
    deflection
        Bristle deflection z at the start [um].
    time_step
        T [s].
    rise, first_velocity, last_velocity
        Displacement over the sample [um], and velocities at its start and end [um/s]. The motion in between is the
        cubic with these values.
    """
    substep = time_step / SUBSTEPS
    start = deflection
    spring = 0.0
    for j in range(SUBSTEPS):
        share = (float(j) + 0.5) / SUBSTEPS
        rest = 1.0 - share
        velocity = 6.0 * share * rest * rise / time_step
        velocity += rest * (1.0 - 3.0 * share) * first_velocity + share * (3.0 * share - 2.0) * last_velocity
        ratio = velocity * c.inverse_stribeck_velocity
        level = c.coulomb_level + (c.static_level - c.coulomb_level) * exp(-ratio * ratio)
        angle = substep * c.stiffness * abs(velocity) / level
        end = deflection
        if angle > 0.0:
            steady = level / c.stiffness if velocity > 0.0 else -level / c.stiffness
            end = steady + (deflection - steady) * exp(-angle)
        spring += 0.5 * (deflection + end)
        deflection = end
    mean = c.stiffness * spring / SUBSTEPS + c.bristle_damping * (deflection - start) / time_step
    return mean, deflection
