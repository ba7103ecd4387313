"""
Initial value compensation of the following controller when it takes over from a seek.

A controller that takes over with an error e_0 and a velocity v_0 has a transient and a step in u. Yamaguchi, Shishida,
Tohyama and Hirai (IEEE Trans. Industrial Electronics 43(1), 1996, pp. 65-73) choose its initial states to minimize the
transient. The states of a custom controller cannot be set, so that the compensation is added to its output instead:

    u = u_follow + b + m d^k,    b + m = gap,    d = exp(-T/tau),

k ticks after the switch. The gap is u of the seek law minus u_follow at the switch, so that u has no step. The constant
b replaces a preset integrator, and m decays. With the responses r_e, r_v, r_b and r_m of the error to
e_0, v_0, b and m, the error is e_0 r_e + v_0 r_v + gap r_m + b (r_b - r_m), and the sum of its squares is smallest for

    b = K_0 e_0 + K_1 v_0 + K_2 gap,    K = -<r_b - r_m, (r_e, r_v, r_m)>/<r_b - r_m, r_b - r_m>.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.sampled_model import NO_SCALES, SampledModel, ideal_outputs
from hdd_servo_ros.bench.dsp import Dsp, DspParameters
from hdd_servo_ros.control.controller import Controller
from hdd_servo_ros.control.observer import DIGITS
from hdd_servo_ros.messages.controller_inputs import ControllerInputs, SensorScales
from hdd_servo_ros.numerics.elementary import exp
from hdd_servo_ros.parameters import ParameterError

Array = NDArray[np.float64]

_ERROR, _VELOCITY, _VOLTAGE = 1e-3, 1.0, 1e-3
"""Initial values for the responses [um, um/s, V]: small, so that the controller hardly adapts."""


class RigidDrive(NamedTuple):
    """A drive without resonances, x'' = a (u - s x - c x')."""

    gain: float
    """Gain a [um/s^2/V]."""
    stiffness: float = 0.0
    """Stiffness s of the pivot friction in presliding [V/um]; 0 in sliding."""
    viscous_coefficient: float = 0.0
    """Viscous coefficient c [V s/um]."""


@dataclasses.dataclass(frozen=True)
class InitialValueGains:
    """
    The gains of b = K_0 e_0 + K_1 v_0 + K_2 gap.

    Attributes
    ----------
    error
        K_0 on the target minus the position at the switch [V/um].
    velocity
        K_1 on the velocity of the head at the switch [V s/um].
    gap
        K_2 on u of the seek law minus u of the following controller at the switch.
    """

    error: float
    velocity: float
    gap: float

    def constant(self, error: float, velocity: float, gap: float) -> float:
        """Return b [V] for the values at the switch [um, um/s, V]; m is ``gap`` minus b."""
        return self.error * error + self.velocity * velocity + self.gap * gap


def initial_value_gains(
    make_controller: Callable[[], Controller],
    drive: RigidDrive,
    time_constant: float,
    sample_time: float,
    horizon: float = 0.01,
    dsp: DspParameters | None = None,
    sensor: SensorScales = NO_SCALES,
) -> InitialValueGains:
    """
    Return the gains that minimize the sum of squared errors after a switch.

    Parameters
    ----------
    make_controller
        Returns the following controller at rest, in its state at a switch; called four times.
    drive
        The drive.
    time_constant
        Time constant tau of the decay of m, above 0 [s].
    sample_time
        T [s].
    horizon
        Time after the switch in which errors count, at least two samples [s].
    dsp
        The DSP block, of which delay and filters are used; None for none.
    sensor
        Scales of the sensor, for a controller that reads its voltages.

    Returns
    -------
    InitialValueGains
        Gains, rounded to 12 digits so that they do not depend on the machine.

    Raises
    ------
    ParameterError
        If the time constant is not positive, or the horizon is shorter than two samples.
    """
    if not 0.0 < time_constant < math.inf:
        raise ParameterError('time_constant', time_constant, 'a finite number above 0 [s]')
    ticks = round(horizon / sample_time)
    if ticks < 2:
        raise ParameterError('horizon', horizon, f'at least two samples, {2.0 * sample_time:g} [s]')
    of_error, of_velocity, of_constant, of_fading = initial_value_responses(
        make_controller, drive, time_constant, sample_time, ticks, dsp, sensor
    )
    effect = of_constant - of_fading
    # Exact sums: those of numpy depend on the vector length of the machine.
    scale = math.fsum(effect * effect)
    found = (-math.fsum(effect * response) / scale for response in (of_error, of_velocity, of_fading))
    return InitialValueGains(*(float(f'{gain:.{DIGITS - 1}e}') for gain in found))


def initial_value_responses(
    make_controller: Callable[[], Controller],
    drive: RigidDrive,
    time_constant: float,
    sample_time: float,
    ticks: int,
    dsp: DspParameters | None = None,
    sensor: SensorScales = NO_SCALES,
) -> Array:
    """
    Return the responses r_e [um/um], r_v [um/(um/s)], r_b and r_m [um/V] of the error, shape (4, ticks).

    Element 0 is at the switch. For the arguments see :func:`initial_value_gains`.
    """
    decay = exp(-sample_time / time_constant)
    kicks = (
        (_ERROR, 0.0, 0.0, 0.0, _ERROR),
        (0.0, _VELOCITY, 0.0, 0.0, _VELOCITY),
        (0.0, 0.0, _VOLTAGE, 1.0, _VOLTAGE),
        (0.0, 0.0, _VOLTAGE, decay, _VOLTAGE),
    )
    ideal = DspParameters() if dsp is None else dsp.without_converter
    count = ideal.updates_per_sample if ideal.is_filtered else 1
    responses = np.zeros((len(kicks), ticks))
    for row, (error, velocity, added, fading, size) in enumerate(kicks):
        controller = make_controller()
        path = Dsp(ideal, sample_time)
        head = SampledModel(drive, (), (), sample_time / count)
        # The target is 0.
        head.start(-error, velocity)
        for tick in range(ticks):
            measured = head.output()
            responses[row, tick] = -measured[0] / size
            inputs = ControllerInputs(tick, *measured, *ideal_outputs(sensor, *measured), 0.0, 0.0, 0.0)
            u, unsaturated, feedback = controller.step(inputs)
            first, _, _ = path.step(u + added, unsaturated + added, feedback)
            added *= fading
            for voltage in path.voltages(first)[:count]:
                head.step(voltage)
    return responses
