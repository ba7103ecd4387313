"""Compiled step of all disturbance sources, for one tick and for many."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.coupling import COUPLING, coupled_force
from hdd_servo_ros.disturbance.flutter import FLUTTER_LAYOUT, flutter_step
from hdd_servo_ros.disturbance.force_noise import FORCE_NOISE_LAYOUT, force_noise
from hdd_servo_ros.disturbance.runout import RUNOUT, repeatable_runout
from hdd_servo_ros.disturbance.shock import SHOCK, shock_mean
from hdd_servo_ros.disturbance.vibration import VIBRATION, vibration_step
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.records import layout, record

CONSTANTS = layout(
    ('runout', RUNOUT),
    ('flutter', FLUTTER_LAYOUT),
    ('force_noise', FORCE_NOISE_LAYOUT),
    ('rotational', VIBRATION),
    ('linear', VIBRATION),
    ('shock', SHOCK),
    ('coupling', COUPLING),
)
"""Constants of all sources."""

Array = NDArray[np.float64]


class DisturbanceArrays(NamedTuple):
    """Array arguments of :func:`disturbance_step`: constants, tables, and states (which the step advances)."""

    constants: Array
    harmonics: Array
    sequence: Array
    modes: Array
    mode_states: Array
    rotational_sections: Array
    rotational_states: Array
    rotational_samples: Array
    linear_sections: Array
    linear_states: Array
    linear_samples: Array


@compiled_apart
def disturbance_step(
    tick: int,
    constants: Array,
    harmonics: Array,
    sequence: Array,
    modes: Array,
    mode_states: Array,
    rotational_sections: Array,
    rotational_states: Array,
    rotational_samples: Array,
    linear_sections: Array,
    linear_states: Array,
    linear_samples: Array,
) -> tuple[float, float, float, float]:
    """
    Return the disturbances held from a tick to the next tick; advances the states from the previous tick.

    Returns
    -------
    force, track_center, linear, angular
        Force against u [V], displacement of the track center [um], acceleration of the base along the head motion
        [m/s^2] and about the pivot axis [rad/s^2].
    """
    c = record(constants, CONSTANTS)
    track_center = 0.0
    if c.runout.is_enabled != 0.0:
        track_center += repeatable_runout(c.runout, harmonics, sequence, tick)
    if c.flutter.is_enabled != 0.0:
        track_center += flutter_step(c.flutter, modes, mode_states, tick)
    linear, angular = 0.0, 0.0
    if c.rotational.is_enabled != 0.0:
        angular += vibration_step(c.rotational, rotational_sections, rotational_states, rotational_samples, tick)
    if c.linear.is_enabled != 0.0:
        linear += vibration_step(c.linear, linear_sections, linear_states, linear_samples, tick)
    if c.shock.is_enabled != 0.0:
        mean = shock_mean(c.shock, tick)
        linear += c.shock.linear * mean
        angular += c.shock.rotational * mean
    force = coupled_force(c.coupling, linear, angular)
    if c.force_noise.is_enabled != 0.0:
        force += force_noise(c.force_noise, tick)
    return force, track_center, linear, angular


@compiled
def disturbance_rows(first_tick: int, arrays: Any, disturbances: Array, accelerations: Array) -> None:
    """
    Write the results of :func:`disturbance_step` for consecutive ticks into zero-initialized rows.

    Parameters
    ----------
    first_tick
        First tick.
    arrays
        Fields of :class:`DisturbanceArrays` as a plain tuple.
    disturbances, accelerations
        Output rows, shapes (n, 3) and (n, 6).
    """
    for row in range(len(disturbances)):
        force, track_center, linear, angular = disturbance_step(first_tick + row, *arrays)
        disturbances[row, 0] = force
        disturbances[row, 1] = track_center
        accelerations[row, 1] = linear
        accelerations[row, 5] = angular
