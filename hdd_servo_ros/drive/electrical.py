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
from hdd_servo_ros.numerics.records import layout, record, zeros

DRIVER = layout(
    'current_ratio',
    'amplifier_decay',
    'amplifier_mean',
    'coil_decay',
    'coil_lag',
    'coil_by_amplifier',
    'back_emf',
    'mean_back_emf',
)
"""
What the kernels know of a driver for its substep of length D.

current_ratio is r; amplifier_decay and coil_decay are e^(-D/tau_a) and e^(-D/tau_e); amplifier_mean the mean of the
former over the substep; coil_lag is tau_e/D; coil_by_amplifier is what a lagging amplifier adds to c; back_emf is kappa
[V s/um], mean_back_emf the part of it that the mean of c has.
"""


def electrical_constants(parameters: ActuatorParameters, substep: float) -> npt.NDArray[np.float64]:
    """Return the constants of the driver's kernels for a substep [s], of the layout :data:`DRIVER`."""
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
    constants = zeros(DRIVER)
    driver = record(constants, DRIVER)
    driver.current_ratio = ratio
    driver.amplifier_decay = amplifier
    driver.amplifier_mean = tau_a / substep * (1.0 - amplifier)
    driver.coil_decay = coil
    driver.coil_lag = lag
    driver.coil_by_amplifier = ratio * crossed
    driver.back_emf = back_emf
    driver.mean_back_emf = back_emf * (1.0 - lag * (1.0 - coil))
    return constants


@compiled
def driver_force(driver: np.record, control: float, amplifier: float, coil: float) -> tuple[float, float, float]:
    """
    Return what the driver does during a substep, the back-EMF apart.

    Parameters
    ----------
    driver
        Record of :data:`DRIVER`.
    control
        u held over the substep [V].
    amplifier, coil
        b and c at the start [V].

    Returns
    -------
    tuple
        b and c at the end [V], mean of c over the substep [V]. :func:`back_emf_current` completes c once the mean
        velocity is known; the mean lacks ``mean_back_emf`` times that velocity.
    """
    ratio = driver.current_ratio
    decay = driver.coil_decay
    offset = amplifier - control
    new_coil = decay * coil + (1.0 - decay) * ratio * control + driver.coil_by_amplifier * offset
    mean_amplifier = control + offset * driver.amplifier_mean
    mean = ratio * mean_amplifier - driver.coil_lag * (new_coil - coil)
    return control + offset * driver.amplifier_decay, new_coil, mean


@compiled
def back_emf_current(driver: np.record, mean_velocity: float) -> float:
    """Return what the back-EMF takes from c by the end of a substep [V]."""
    share: float = (1.0 - driver.coil_decay) * driver.back_emf
    return share * mean_velocity
