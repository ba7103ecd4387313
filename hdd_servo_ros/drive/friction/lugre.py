"""
The LuGre model (2.20)-(2.22), as the curve of steady sliding and as a compiled step for the plant.

The bristle is stiff: its rate sigma_0 |v| / g(v) reaches 5e5 1/s in section 5.4. Over one substep of length D the mean
velocity w is held, so that the bristle equation is linear and is solved exactly,

    z(D) = z e^(-X) + w D p1(X),    integral of z = z D p1(X) + w D^2 p2(X),    X = D sigma_0 |w| / g(w),

with p1(X) = (1 - e^(-X)) / X and p2(X) = (1 - p1) / X. The momentum equation is written in impulses, so that it is
linear in w as well; only X depends on w otherwise, and is found by fixed-point passes. The step is symmetric in time,
of second order, and bounded for any stiffness.
"""

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp

PASSES = 2
"""Fixed-point passes for the mean velocity of a substep; a third changes the result by less than the step's error."""


@compiled
def decay_functions(x: float) -> tuple[float, float]:
    """Return p1 = (1 - exp(-x)) / x and p2 = (1 - p1) / x of x >= 0, without cancellation near zero."""
    if x < 0.1:
        p2 = 0.5 - x * (
            0.16666666666666666
            - x
            * (
                0.041666666666666664
                - x
                * (
                    0.008333333333333333
                    - x
                    * (
                        0.001388888888888889
                        - x * (0.0001984126984126984 - x * (2.48015873015873e-05 - x * 2.7557319223985893e-06))
                    )
                )
            )
        )
        return 1.0 - x * p2, p2
    p1 = (1.0 - exp(-x)) / x
    return p1, (1.0 - p1) / x


@compiled
def lugre_level(velocity: float, coulomb_level: float, static_level: float, stribeck_velocity: float) -> float:
    """Return g(v) = f_c + (f_s - f_c) exp(-(v/v_s)^2), the denominator of (2.22), in the unit of the levels."""
    ratio = velocity / stribeck_velocity
    return coulomb_level + (static_level - coulomb_level) * exp(-ratio * ratio)


@compiled
def lugre_force(
    velocity: float,
    bristle: float,
    stiffness: float,
    bristle_damping: float,
    viscous_coefficient: float,
    level: float,
) -> float:
    """Return the friction (2.20) of a velocity and a bristle deflection, with g(v) given as ``level``."""
    rate = velocity - stiffness * abs(velocity) / level * bristle
    return stiffness * bristle + bristle_damping * rate + viscous_coefficient * velocity


@compiled
def lugre_substep(
    substep: float,
    inertia: float,
    velocity: float,
    bristle: float,
    previous_force: float,
    applied: float,
    stiffness: float,
    bristle_damping: float,
    viscous_coefficient: float,
    coulomb_level: float,
    static_level: float,
    stribeck_velocity: float,
) -> tuple[float, float, float]:
    """
    Advance a rigid body with LuGre friction by one substep.

    Parameters
    ----------
    substep
        Length D of the substep [s].
    inertia
        m of (4.1), the inverse of the plant's gain [V s^2/um].
    velocity, bristle
        v [um/s] and z [um] at the start.
    previous_force
        Mean friction of the substep before [V], from which the mean velocity is predicted.
    applied
        Mean of u - d over the substep [V].
    stiffness, bristle_damping, viscous_coefficient
        sigma_0 [V/um], sigma_1 and sigma_2 [V s/um].
    coulomb_level, static_level, stribeck_velocity
        f_c, f_s [V] and v_s [um/s].

    Returns
    -------
    tuple
        Mean velocity w of the substep (the velocity at its end is 2 w - v) [um/s], bristle deflection at its end [um],
        mean friction [V].
    """
    mean = velocity + 0.5 * substep * (applied - previous_force) / inertia
    decay_1 = 1.0
    decay_2 = 0.5
    relaxed = 0.0
    for _ in range(PASSES):
        level = lugre_level(mean, coulomb_level, static_level, stribeck_velocity)
        x = substep * stiffness * abs(mean) / level
        decay_1, decay_2 = decay_functions(x)
        relaxed = bristle * x * decay_1
        impulse = substep * (applied - stiffness * bristle * decay_1) + bristle_damping * relaxed
        resistance = substep * (substep * stiffness * decay_2 + bristle_damping * decay_1 + viscous_coefficient)
        mean = (2.0 * inertia * velocity + impulse) / (2.0 * inertia + resistance)
    change = mean * substep * decay_1 - relaxed
    force = (
        stiffness * (bristle * decay_1 + mean * substep * decay_2)
        + bristle_damping * change / substep
        + viscous_coefficient * mean
    )
    return mean, bristle + change, force
