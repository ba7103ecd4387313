"""What lies between a controller's law and the drive: the DSP's computation delay and digital-to-analog converter."""

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
"""Delay [samples], limit and converter of :func:`dsp_step`."""

DSP_STATE = layout('command', 'unsaturated', 'feedback', 'saturated_samples')
"""The last command, and how many were limited."""


@dataclasses.dataclass(frozen=True)
class DspParameters(ParameterSet):
    """Parameters of :class:`Dsp`; with the defaults it passes every command on as it is."""

    dac_bits: int = parameter(
        0, 'resolution of the digital-to-analog converter, 0 for an ideal one', unit='bit', minimum=0, maximum=32
    )
    dac_range: float = parameter(
        0.0,
        'the converter covers -dac_range to +dac_range; 0 for no limit, which only an ideal converter can have',
        unit='V',
        minimum=0.0,
    )
    computation_delay: int = parameter(
        0, 'samples by which the command comes late, since it has to be computed', unit='samples', minimum=0, maximum=1
    )

    def check_together(self) -> None:
        """Reject a resolution without a range, and a converter without a positive code."""
        if self.dac_bits == 1:
            raise ParameterError('dac_bits', self.dac_bits, '0 (ideal), or at least 2')
        if self.dac_bits > 0 and self.dac_range == 0.0:
            raise ParameterError('dac_range', self.dac_range, f'above 0 V with dac_bits = {self.dac_bits}')


@dataclasses.dataclass(frozen=True)
class ControllerOutputParameters(ParameterSet):
    """Parameters of every controller node after its law."""

    dsp: DspParameters = group(DspParameters)


@dataclasses.dataclass(frozen=True)
class ControllerInputParameters(ParameterSet):
    """Parameters of every controller node before its law: how it scales the sensor's outputs."""

    displacement_scale: float = parameter(
        0.0,
        "head displacement per volt of the sensor's displacement output; 0 takes that of ldv_sensor",
        unit='um/V',
        minimum=0.0,
        read_only=True,
    )
    velocity_scale: float = parameter(
        0.0,
        "head velocity per volt of the sensor's velocity output; 0 takes that of ldv_sensor",
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
    """Return what `/control` carries at the tick at which a law has computed (u, unsaturated, feedback)."""
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
    The digital side's way out: saturation, quantization and computation delay between any controller and `/control`.

    The law's voltage is clipped to the converter's range and to what the drive takes, rounded to the converter's step,
    and held from this tick on, or from the next with a computation delay of one sample; before the first command is
    there, 0 V is held. What is returned belongs together: with a delay, the voltage before the limit and the feedback
    part are those of the voltage that is held now. Values that are not finite pass through.

    Parameters
    ----------
    parameters
        Converter and delay.
    sample_time
        T [s]; for likeness with the other blocks, the delay counts in samples.
    drive_limit
        Largest magnitude of voltage that the drive takes [V], so that what is said to be held is held.

    Attributes
    ----------
    state
        The last command (voltage, voltage before the limit, feedback part [V]) and the number of commands that were
        limited, by the controller or here.

    Notes
    -----
    Source: a model of this package; thesis section 5.2 describes the DSP of the experiments.

    Examples
    --------
    A command of 12 V, for a drive that takes 10 V, held one sample late:

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
        """Take other parameters from the next tick on; the command under way and the count stay."""
        self.parameters = parameters
        constants = zeros(DSP)
        c = record(constants, DSP)
        c.delay = parameters.computation_delay
        c.limit = min(parameters.dac_range if parameters.dac_range > 0.0 else math.inf, self.drive_limit)
        c.step, c.lowest, c.highest = converter_codes(parameters.dac_bits, parameters.dac_range)
        self.arrays: DspArrays = (constants, self.state)

    @property
    def limit(self) -> float:
        """The largest magnitude of voltage that comes out on both sides of zero [V], infinity if there is none."""
        c = record(self.arrays[0], DSP)
        if self.parameters.dac_bits > 0:
            return min(float(c.highest * c.step), self.drive_limit)
        return float(c.limit)

    @property
    def saturated_samples(self) -> int:
        """How many commands so far were limited, by the controller, the converter or the drive."""
        return int(record(self.state, DSP_STATE).saturated_samples)

    def step(self, u: float, unsaturated: float, feedback: float) -> tuple[float, float, float]:
        """
        Take a law's output of this tick and return what is held from this tick on.

        Parameters
        ----------
        u, unsaturated, feedback
            As :meth:`~hdd_servo_ros.control.controller.Controller.step` returns them [V].

        Returns
        -------
        u, unsaturated, feedback
            The voltage held until the next tick, the same command's voltage before any limit, its feedback part [V].
        """
        return dsp_step(*self.arrays, u, unsaturated, feedback)
