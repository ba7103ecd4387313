"""
Driver and coil dynamics over one substep, exact for a held control signal and a constant velocity.

Let c be the coil current referred to the control signal: c = I_m/k_a [V], or R_m I_m/k_a with a voltage driver. Both
drivers of section 3.2.2 then obey

    tau_a b' = u - b,    tau_e c' = r b - c - kappa v,

with amplifier output b, r = R_s/(R_m + R_s) (1 with a voltage driver) and back-EMF coefficient kappa. The mean of c
over a substep is therefore a force that is linear in the mean velocity. The friction steps take it as an applied force
and a viscous damping.
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
Driver constants of the kernels, for a substep of length D.

current_ratio is r; amplifier_decay and coil_decay are e^(-D/tau_a) and e^(-D/tau_e); amplifier_mean is the mean of
e^(-t/tau_a) over the substep; coil_lag is tau_e/D; coil_by_amplifier is the gain from the amplifier's lag b - u to c;
back_emf is kappa [V s/um]; mean_back_emf is the part of kappa that acts on the mean of c.
"""


def electrical_constants(parameters: ActuatorParameters, substep: float) -> npt.NDArray[np.float64]:
    """Return the driver constants of the kernels for a substep [s], in the layout :data:`DRIVER`."""
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
    Advance the driver by one substep, without the back-EMF.

    Parameters
    ----------
    driver
        Record with the layout :data:`DRIVER`.
    control
        u held over the substep [V].
    amplifier, coil
        b and c at the start [V].

    Returns
    -------
    tuple
        b and c at the end [V], and the mean of c over the substep [V]. Once the mean velocity is known, subtract
        :func:`back_emf_current` from c, and ``mean_back_emf`` times the mean velocity from the mean of c.
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
    """Return the decrease of c due to the back-EMF at the end of a substep [V]."""
    share: float = (1.0 - driver.coil_decay) * driver.back_emf
    return share * mean_velocity
