"""Command path from controller to drive: computation delay and digital-to-analog converter of the DSP."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import beyond_codes, converted, converter_codes
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

DspArrays = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Constants and state."""

DSP = layout('delay', 'limit', 'step', 'lowest', 'highest')
"""Delay [samples], voltage limit and converter of :func:`dsp_step`."""

DSP_STATE = layout('command', 'unsaturated', 'feedback', 'saturated_samples')
"""Last command, and the number of limited commands."""


@dataclasses.dataclass(frozen=True)
class DspParameters(ParameterSet):
    """Parameters of :class:`Dsp`; with the defaults, commands pass unchanged."""

    dac_bits: int = parameter(0, 'DAC resolution; 0 for an ideal DAC', unit='bit', minimum=0, maximum=32)
    dac_range: float = parameter(
        0.0,
        'DAC output range, -dac_range to +dac_range; 0 for no limit (ideal DAC only)',
        unit='V',
        minimum=0.0,
    )
    computation_delay: int = parameter(0, 'computation delay of the command', unit='samples', minimum=0, maximum=1)

    def check_together(self) -> None:
        """Reject a resolution without a range, and a DAC without a positive code."""
        if self.dac_bits == 1:
            raise ParameterError('dac_bits', self.dac_bits, '0 (ideal DAC) or at least 2')
        if self.dac_bits > 0 and self.dac_range == 0.0:
            raise ParameterError('dac_range', self.dac_range, f'above 0 V, because dac_bits is {self.dac_bits}')


@dataclasses.dataclass(frozen=True)
class ControllerOutputParameters(ParameterSet):
    """Parameters of the command path, declared by every controller node."""

    dsp: DspParameters = group(DspParameters)


@dataclasses.dataclass(frozen=True)
class ControllerInputParameters(ParameterSet):
    """Parameters of the sensor input, declared by every controller node: scales of the sensor outputs."""

    displacement_scale: float = parameter(
        0.0,
        'head displacement per volt of the displacement output; 0 uses the value of ldv_sensor',
        unit='um/V',
        minimum=0.0,
        read_only=True,
    )
    velocity_scale: float = parameter(
        0.0,
        'head velocity per volt of the velocity output; 0 uses the value of ldv_sensor',
        unit='um/s/V',
        minimum=0.0,
        read_only=True,
    )


@compiled
def dsp_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    u: float,
    unsaturated: float,
    feedback: float,
) -> tuple[float, float, float]:
    """Return the values for ``/control`` at the tick at which the controller computed (u, unsaturated, feedback)."""
    c = record(constants, DSP)
    s = record(state, DSP_STATE)
    if abs(u) < math.inf:
        limit = c.limit
        if u != unsaturated or abs(u) > limit or beyond_codes(u, c.step, c.lowest, c.highest):
            s.saturated_samples += 1.0
        u = min(max(u, -limit), limit)
        u = converted(u, c.step, c.lowest, c.highest)
    held = u, unsaturated, feedback
    if c.delay > 0.0:
        held = s.command, s.unsaturated, s.feedback
    s.command = u
    s.unsaturated = unsaturated
    s.feedback = feedback
    return held


class Dsp:
    """
    Command output of the DSP: saturation, quantization and computation delay between controller and ``/control``.

    The controller voltage is clipped to the DAC range and to the input limit of the drive, and rounded to the DAC step.
    It is held from this tick on, or from the next tick with a computation delay of one sample. Until the first command
    has arrived, 0 V is held. The returned values belong to the same command: with a delay, the voltage before the limit
    and the feedback part are those of the voltage held now. Non-finite values pass through.

    Parameters
    ----------
    parameters
        Parameters of the DAC and the delay.
    sample_time
        T [s]; unused, because the delay is in samples, but present for consistency with the other blocks.
    drive_limit
        Input voltage limit of the drive [V], so that the reported command equals the applied voltage.

    Attributes
    ----------
    state
        Last command (voltage, voltage before the limit, feedback part [V]), and the number of commands limited by the
        controller or by the DSP.

    Notes
    -----
    Source: a model of this package; thesis section 5.2 describes the DSP of the experiments.

    Examples
    --------
    A command of 12 V for a drive with a limit of 10 V, held with a delay of one sample:

    >>> from hdd_servo_ros.bench import Dsp, DspParameters
    >>> dsp = Dsp(DspParameters(computation_delay=1), sample_time=1e-4, drive_limit=10.0)
    >>> dsp.step(12.0, 12.0, 12.0)
    (0.0, 0.0, 0.0)
    >>> dsp.step(1.0, 1.0, 1.0)
    (10.0, 12.0, 12.0)
    >>> dsp.saturated_samples
    1
    """

    def __init__(self, parameters: DspParameters, sample_time: float, drive_limit: float = math.inf) -> None:
        self.sample_time = sample_time
        self.drive_limit = drive_limit
        self.state = zeros(DSP_STATE)
        self.update(parameters)

    def update(self, parameters: DspParameters) -> None:
        """Change the parameters from the next tick on; the pending command and the count are kept."""
        self.parameters = parameters
        constants = zeros(DSP)
        c = record(constants, DSP)
        c.delay = parameters.computation_delay
        c.limit = min(parameters.dac_range if parameters.dac_range > 0.0 else math.inf, self.drive_limit)
        c.step, c.lowest, c.highest = converter_codes(parameters.dac_bits, parameters.dac_range)
        self.arrays: DspArrays = (constants, self.state)

    @property
    def limit(self) -> float:
        """Largest output voltage available with both signs [V]; infinity without a limit."""
        c = record(self.arrays[0], DSP)
        if self.parameters.dac_bits > 0:
            return min(float(c.highest * c.step), self.drive_limit)
        return float(c.limit)

    @property
    def saturated_samples(self) -> int:
        """Number of commands limited so far, by the controller, the DAC or the drive limit."""
        return int(record(self.state, DSP_STATE).saturated_samples)

    def step(self, u: float, unsaturated: float, feedback: float) -> tuple[float, float, float]:
        """
        Process the controller output of this tick; return the command held from this tick on.

        Parameters
        ----------
        u, unsaturated, feedback
            Result of :meth:`~hdd_servo_ros.control.controller.Controller.step` [V].

        Returns
        -------
        u, unsaturated, feedback
            Voltage held until the next tick; voltage of the same command before any limit; its feedback part [V].
        """
        return dsp_step(*self.arrays, u, unsaturated, feedback)
