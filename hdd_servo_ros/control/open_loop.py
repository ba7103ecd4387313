"""Open-loop controller: the reference is the drive voltage."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import all_finite, saturated
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterSet, parameter

OpenLoopArrays = tuple[NDArray[np.float64], NDArray[np.float64]]

CONSTANTS = layout('time_step', 'control_limit')

ESTIMATE_NAMES = ('t',)
ESTIMATES = layout(*ESTIMATE_NAMES)


@dataclasses.dataclass(frozen=True)
class OpenLoopParameters(ParameterSet):
    """Parameters of :class:`OpenLoop`."""

    control_limit: float = parameter(10.0, 'largest magnitude of the drive voltage', unit='V', above=0.0)


@compiled
def open_loop_step(
    constants: NDArray[np.float64],
    estimates: NDArray[np.float64],
    *values: Any,
) -> tuple[float, float, float]:
    """Return (u, u before the limit, 0) with u = x_d in volts."""
    inputs = ControllerInputs(*values)
    if not all_finite(inputs):
        return math.nan, math.nan, math.nan
    c = record(constants, CONSTANTS)
    record(estimates, ESTIMATES).t = float(inputs.tick) * c.time_step
    u = inputs.desired_position
    return saturated(u, c.control_limit), u, 0.0


class OpenLoop:
    """
    Open-loop controller u = x_d, with the reference in volts, for hysteresis curves and swept sines.

    It uses no measurement, so the feedback part of its command is zero.

    Parameters
    ----------
    parameters
        Limit of the drive voltage.
    sample_time
        T [s].

    Notes
    -----
    Source: open-loop experiments of thesis sections 5.3 and 5.4.

    Examples
    --------
    >>> from hdd_servo_ros.control import ControllerInputs, OpenLoop, OpenLoopParameters
    >>> controller = OpenLoop(OpenLoopParameters(control_limit=1.0), sample_time=1e-4)
    >>> controller.step(ControllerInputs(0, 0.0, 0.0, 0.0, 0.0, desired_position=1.5, desired_velocity=0.0,
    ...                                  desired_acceleration=0.0))
    (1.0, 1.5, 0.0)
    """

    estimate_names = ESTIMATE_NAMES

    def __init__(self, parameters: OpenLoopParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        self._output_limit = math.inf
        self.constants = zeros(CONSTANTS)
        self.estimates = zeros(ESTIMATES)
        self.arrays: OpenLoopArrays = (self.constants, self.estimates)
        """Array arguments of the kernel, in order: constants, estimates."""
        self.update(parameters)

    def update(self, parameters: OpenLoopParameters) -> None:
        """Use new parameters from the next tick on."""
        self._apply(parameters)

    def limit_output(self, limit: float) -> None:
        """Limit the drive voltage also to +-``limit`` [V], the range of the converter after the controller."""
        self._output_limit = limit
        self._apply(self.parameters)

    def _apply(self, parameters: OpenLoopParameters) -> None:
        self.parameters = parameters
        c = record(self.constants, CONSTANTS)
        c.time_step = self.sample_time
        c.control_limit = min(parameters.control_limit, self._output_limit)

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """Return u, u before the limit, and its feedback part (0) [V]; see :class:`Controller`."""
        return open_loop_step(*self.arrays, *inputs)
