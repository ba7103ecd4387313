"""
The driver's and coil's dynamics over one substep, exact for a held control and a constant velocity.

With the coil current referred to the control signal, c = I_m/k_a [V] or R_m I_m/k_a on a voltage driver, both drivers
of section 3.2.2 are

    tau_a b' = u - b,    tau_e c' = r b - c - kappa v,

with r = R_s/(R_m + R_s) (1 on a voltage driver) and kappa the back-EMF. The mean of c over a substep is then a force
linear in the substep's mean velocity, which is what the friction's steps take: an applied force and a resistance.
"""

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.drive.actuator import ActuatorParameters
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import exp

# Places in the constants
RATIO = 0
AMPLIFIER_DECAY = 1
AMPLIFIER_MEAN = 2
COIL_DECAY = 3
COIL_LAG = 4
COIL_AMPLIFIER = 5
BACK_EMF = 6
MEAN_BACK_EMF = 7
COUNT = 8


def electrical_constants(parameters: ActuatorParameters, substep: float) -> list[float]:
    """Return the constants of the driver's kernels for a substep [s]."""
    tau_a = parameters.amplifier_time_constant
    tau_e = parameters.electrical_time_constant
    ratio = parameters.current_ratio
    amplifier = exp(-substep / tau_a) if tau_a > 0.0 else 0.0
    coil = exp(-substep / tau_e) if tau_e > 0.0 else 0.0
    if abs(tau_a - tau_e) > 1.0e-6 * tau_e:
        crossed = tau_a * (amplifier - coil) / (tau_a - tau_e)
    elif tau_e > 0.0:
        crossed = coil * substep / tau_e
    else:
        crossed = 0.0
    lag = tau_e / substep
    back_emf = parameters.back_emf_resistance
    return [
        ratio,
        amplifier,
        tau_a / substep * (1.0 - amplifier),
        coil,
        lag,
        ratio * crossed,
        back_emf,
        back_emf * (1.0 - lag * (1.0 - coil)),
    ]


@compiled
def driver_force(
    constants: npt.NDArray[np.float64], place: int, control: float, amplifier: float, coil: float
) -> tuple[float, float, float]:
    """
    Return what the driver does during a substep, the back-EMF apart.

    Parameters
    ----------
    constants, place
        The driver's constants begin at ``place`` of this array.
    control
        u held over the substep [V].
    amplifier, coil
        b and c at the start [V].

    Returns
    -------
    tuple
        b and c at the end [V], mean of c over the substep [V]. :func:`back_emf_current` completes c once the mean
        velocity is known; the mean lacks ``MEAN_BACK_EMF`` times that velocity.
    """
    ratio = constants[place + RATIO]
    offset = amplifier - control
    decay = constants[place + COIL_DECAY]
    new_coil = decay * coil + (1.0 - decay) * ratio * control + constants[place + COIL_AMPLIFIER] * offset
    mean_amplifier = control + offset * constants[place + AMPLIFIER_MEAN]
    mean = ratio * mean_amplifier - constants[place + COIL_LAG] * (new_coil - coil)
    return control + offset * constants[place + AMPLIFIER_DECAY], new_coil, mean


@compiled
def back_emf_current(constants: npt.NDArray[np.float64], place: int, mean_velocity: float) -> float:
    """Return what the back-EMF takes from c by the end of a substep [V]."""
    share: float = (1.0 - constants[place + COIL_DECAY]) * constants[place + BACK_EMF]
    return share * mean_velocity
