"""The drive linearised and sampled: a state space between two ticks, and its frequency response."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.drive.resonance import modal_form

Array = NDArray[np.float64]

POSITION, VELOCITY = 0, 1
"""Indices of the rigid body's states; those of the modes and of the driver follow."""


@dataclasses.dataclass(frozen=True)
class SampledDrive:
    """
    x_{k+1} = A x_k + B u_k, (position, velocity)_k = C x_k: the drive with hold and sampler, u_k held from tick k on.

    There is no further delay: as in the loop, u_k answers the measurement of tick k and acts from then on.
    """

    a: Array
    b: Array
    c: Array
    sample_time: float

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return position [um/V] and velocity [um/s/V] over u at ``frequencies`` [Hz], shape (len(frequencies), 2)."""
        z = np.exp(2j * np.pi * np.asarray(frequencies) * self.sample_time)
        poles, vectors = np.linalg.eig(self.a)
        # A rigid body has a double pole at z = 1, which has no full set of eigenvectors: solve then.
        if np.linalg.cond(vectors) < 1e10:
            residues = (self.c @ vectors) * np.linalg.solve(vectors, self.b.astype(np.complex128))[:, 0]
            return np.asarray((residues[None, :, :] / (z[:, None, None] - poles)).sum(axis=2))
        eye = np.eye(len(self.a))
        return np.array([(self.c @ np.linalg.solve(value * eye - self.a, self.b))[:, 0] for value in z])


def sampled_drive(plant: PlantParameters, sample_time: float, presliding: bool) -> SampledDrive:
    """
    Linearise the drive and discretise it exactly under a zero-order hold.

    Amplifier, coil and back-EMF of a current or voltage driver are part of it.

    Parameters
    ----------
    plant
        The drive.
    sample_time
        T [s].
    presliding
        True: the friction is the spring sigma_0 with the dampers sigma_1 and sigma_2, as for the smallest motion.
        False: only the damper sigma_2 is left, as in fast sliding. Friction models other than LuGre count as none.
    """
    modal = modal_form(plant.resonance)
    mechanical = 2 + 2 * len(modal.modes)
    driver, current = _driver(plant.actuator, mechanical)
    size = mechanical + len(driver)
    friction = np.zeros(size + 1)
    friction[[POSITION, VELOCITY]] = _friction(plant.friction, presliding)
    # The modes, like the rigid body, are driven by the net acceleration.
    acceleration = plant.rigid_gain * (current - friction)
    # A row for each state and one for u, which is held: its derivative by the states and u.
    derivative = np.zeros((size + 1, size + 1))
    derivative[mechanical:size] = driver
    derivative[POSITION, VELOCITY] = 1.0
    derivative[VELOCITY] = acceleration
    c = np.zeros((2, size))
    c[0, [POSITION, VELOCITY]] = modal.r0, modal.r1
    c[1, VELOCITY] = modal.r0
    for i, mode in enumerate(modal.modes):
        q = 2 + 2 * i
        derivative[q, q + 1] = 1.0
        derivative[q + 1] = acceleration
        derivative[q + 1, q] -= mode.a0
        derivative[q + 1, q + 1] -= mode.a1
        c[0, q : q + 2] = mode.gamma, mode.beta
        c[1, q : q + 2] = -mode.beta * mode.a0, mode.gamma - mode.beta * mode.a1
    from scipy.linalg import expm  # late: it takes as long to import as half of a node, which may never come here

    transition = expm(derivative * sample_time)
    return SampledDrive(transition[:size, :size], transition[:size, size:], c, sample_time)


def _friction(parameters: FrictionParameters, presliding: bool) -> tuple[float, float]:
    """Return the stiffness [V/um] and the damping [V s/um] of the linearised friction."""
    if parameters.model not in ('lugre', 'lugre_position'):
        return 0.0, 0.0
    if not presliding:
        return 0.0, parameters.viscous_coefficient
    return parameters.stiffness, parameters.bristle_damping + parameters.viscous_coefficient


def _driver(parameters: ActuatorParameters, mechanical: int) -> tuple[Array, Array]:
    """
    Return the driver's dynamics and the coil current that drives the rigid body.

    They are tau_a b' = u - b and tau_e c' = r b - c - kappa v of :mod:`~hdd_servo_ros.drive.electrical`; a time
    constant of zero makes no state. Without electrical dynamics the current is u.

    Parameters
    ----------
    parameters
        The actuator and its driver.
    mechanical
        Number of states before the driver's.

    Returns
    -------
    tuple
        Derivatives of b and c, as far as they are states, shape (count, n + 1), and the current, referred to the
        control [V], shape (n + 1,): coefficients of all n = mechanical + count states and, last, of u.
    """
    electrical = parameters.is_electrical
    time_constants = parameters.amplifier_time_constant, parameters.electrical_time_constant
    has_amplifier, has_coil = (electrical and constant > 0.0 for constant in time_constants)
    size = mechanical + has_amplifier + has_coil
    unit = np.eye(size + 1)
    derivatives = np.zeros((size - mechanical, size + 1))
    current: Array = unit[size]
    if has_amplifier:
        derivatives[0] = (current - unit[mechanical]) / parameters.amplifier_time_constant
        current = unit[mechanical]
    if electrical:
        current = parameters.current_ratio * current - parameters.back_emf_resistance * unit[VELOCITY]
    if has_coil:
        derivatives[-1] = (current - unit[size - 1]) / parameters.electrical_time_constant
        current = unit[size - 1]
    return derivatives, current
