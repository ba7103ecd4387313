"""Command path from controller to drive: computation delay and digital-to-analog converter of the DSP."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import beyond_codes, converted, converter_codes
from hdd_servo_ros.bench.output_filters import FilterParameters, OutputFilters, filters_step
from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

DspArrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Constants, state, updates within the sample and chain of filters."""

UPDATES = (1, 2, 4)
"""Allowed numbers of command updates per sample."""
INTERPOLATIONS = ('hold', 'linear')
"""Values of ``dsp.interpolation``, in the order of their numbers in the kernel."""

DSP = layout('delay', 'limit', 'step', 'lowest', 'highest', 'updates', 'is_linear', 'is_plain')
"""
Constants of :func:`dsp_step`.

Delay [samples], voltage limit, converter, updates per sample, interpolation, and whether there is one update without
filters.
"""

DSP_STATE = layout('command', 'unsaturated', 'feedback', 'saturated_samples', 'previous')
"""Last command, the number of limited commands, and the controller voltage of the last sample."""

QUARTERS = 3
"""Later voltages of a sample: from one quarter, from half and from three quarters of the sample on."""


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
    updates_per_sample: int = parameter(
        1,
        'updates of the command per sample: 1, 2 or 4; above 1, /control_updates carries the later voltages',
        minimum=1,
        maximum=4,
        read_only=True,
    )
    interpolation: str = parameter(
        'hold',
        "controller voltage between samples, with updates_per_sample above 1: 'hold' for a constant voltage, 'linear' "
        'for equal steps from the voltage of the last sample to that of this sample',
        choices=INTERPOLATIONS,
    )
    filters: FilterParameters = group(FilterParameters)

    @property
    def is_multirate(self) -> bool:
        """Whether the command changes within a sample."""
        return self.updates_per_sample > 1

    @property
    def is_interpolated(self) -> bool:
        """Whether the command reaches the controller voltage in steps."""
        return self.is_multirate and self.interpolation == 'linear'

    @property
    def is_filtered(self) -> bool:
        """Whether the command differs from a held controller voltage, by interpolation or filters."""
        return self.is_interpolated or self.filters.is_used

    @property
    def without_converter(self) -> 'DspParameters':
        """The same delay, updates and filters with an ideal converter."""
        return dataclasses.replace(self, dac_bits=0, dac_range=0.0)

    def check_together(self) -> None:
        """Reject other numbers of updates, a resolution without a range, and a DAC without a positive code."""
        if self.updates_per_sample not in UPDATES:
            raise ParameterError('updates_per_sample', self.updates_per_sample, '1, 2 or 4')
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
    updates: NDArray[np.float64],
    chain: NDArray[np.float64],
    u: float,
    unsaturated: float,
    feedback: float,
) -> tuple[float, float, float]:
    """
    Return the values for ``/control`` at the tick at which the controller computed (u, unsaturated, feedback).

    With more than one update per sample, the first row of ``updates`` then holds the later voltages of the sample and
    the mean of all; its second row holds those of the pending command. ``chain`` is that of
    :class:`~hdd_servo_ros.bench.output_filters.OutputFilters`.
    """
    c = record(constants, DSP)
    s = record(state, DSP_STATE)
    if c.is_plain == 0.0:
        return _filtered_step(constants, state, updates, chain, u, unsaturated, feedback)
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


@compiled_apart
def _filtered_step(
    constants: NDArray[np.float64],
    state: NDArray[np.float64],
    updates: NDArray[np.float64],
    chain: NDArray[np.float64],
    u: float,
    unsaturated: float,
    feedback: float,
) -> tuple[float, float, float]:
    """Filter, limit, round and delay each update of a sample; not inlined, because most runs do not need it."""
    c = record(constants, DSP)
    s = record(state, DSP_STATE)
    count = int(c.updates)
    is_limited = u != unsaturated
    first, first_unlimited, total = 0.0, 0.0, 0.0
    for j in range(QUARTERS):
        updates[0, j] = updates[1, j]
    updates[0, QUARTERS] = updates[1, QUARTERS]
    for i in range(count):
        voltage = u
        if c.is_linear > 0.0 and i < count - 1:
            voltage = s.previous + (u - s.previous) * (float(i + 1) / c.updates)
        voltage = filters_step(chain, voltage)
        unlimited = voltage
        if abs(voltage) < math.inf:
            if abs(voltage) > c.limit or beyond_codes(voltage, c.step, c.lowest, c.highest):
                is_limited = True
            voltage = min(max(voltage, -c.limit), c.limit)
            voltage = converted(voltage, c.step, c.lowest, c.highest)
        if i == 0:
            first, first_unlimited = voltage, unlimited
        total += voltage
        for j in range(QUARTERS):
            if (j + 1) * count // 4 == i:
                updates[1, j] = voltage
    updates[1, QUARTERS] = total / c.updates
    if is_limited and abs(u) < math.inf:
        s.saturated_samples += 1.0
    s.previous = u
    if first_unlimited == u:
        first_unlimited = unsaturated
    elif unsaturated != u:
        first_unlimited += unsaturated - u
    held = first, first_unlimited, feedback
    if c.delay > 0.0:
        held = s.command, s.unsaturated, s.feedback
    else:
        for j in range(QUARTERS + 1):
            updates[0, j] = updates[1, j]
    s.command, s.unsaturated, s.feedback = first, first_unlimited, feedback
    return held


class Dsp:
    """
    Command output of the DSP: saturation, quantization and computation delay between controller and ``/control``.

    The controller voltage is clipped to the DAC range and to the input limit of the drive, and rounded to the DAC step.
    It is held from this tick on, or from the next tick with a computation delay of one sample. Until the first command
    has arrived, 0 V is held. The returned values belong to the same command: with a delay, the voltage before the limit
    and the feedback part are those of the voltage held now. Non-finite values pass through.

    With 2 or 4 updates per sample the voltage may change within the sample. Limit, rounding and delay apply to each
    voltage; :attr:`later_voltages` returns those after the first. A chain of filters, if there is one, filters the
    voltages of the updates before the limit.

    Parameters
    ----------
    parameters
        Parameters of the DAC and the delay.
    sample_time
        T [s].
    drive_limit
        Input voltage limit of the drive [V], so that the reported command equals the applied voltage.

    Attributes
    ----------
    state
        Last command (voltage, voltage before the limit, feedback part [V]), the number of commands limited by the
        controller or by the DSP, and the last voltage of the controller.
    filters
        The chain of filters.

    Raises
    ------
    ParameterError
        If the frequency of a filter is not below the Nyquist frequency of the updates.

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

    Four updates per sample, in equal steps to the voltage of the controller:

    >>> fast = Dsp(DspParameters(updates_per_sample=4, interpolation='linear'), sample_time=1e-4)
    >>> fast.step(1.0, 1.0, 1.0)
    (0.25, 0.25, 1.0)
    >>> fast.later_voltages
    (0.5, 0.75, 1.0)
    """

    def __init__(self, parameters: DspParameters, sample_time: float, drive_limit: float = math.inf) -> None:
        self.sample_time = sample_time
        self.drive_limit = drive_limit
        self.state = zeros(DSP_STATE)
        self.updates = np.zeros((2, QUARTERS + 1))
        self.filters = OutputFilters(parameters.filters, sample_time / parameters.updates_per_sample)
        self.update(parameters)

    def update(self, parameters: DspParameters) -> None:
        """
        Change the parameters from the next tick on; the pending command and the count are kept.

        A change of the filters causes no step in the command.
        """
        if self.filters.is_idle:
            self.filters.hold(float(record(self.state, DSP_STATE).command))
        self.filters.update(parameters.filters)
        self.parameters = parameters
        constants = zeros(DSP)
        c = record(constants, DSP)
        c.delay = parameters.computation_delay
        c.limit = min(parameters.dac_range if parameters.dac_range > 0.0 else math.inf, self.drive_limit)
        c.step, c.lowest, c.highest = converter_codes(parameters.dac_bits, parameters.dac_range)
        c.updates = parameters.updates_per_sample
        c.is_linear = INTERPOLATIONS.index(parameters.interpolation)
        c.is_plain = not parameters.is_multirate and self.filters.is_idle
        self.arrays: DspArrays = (constants, self.state, self.updates, self.filters.chain)

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

    @property
    def later_voltages(self) -> tuple[float, float, float]:
        """
        Voltages held from one quarter, half and three quarters of the sample on [V].

        With one update per sample, the voltage does not change within the sample, and these are 0.
        """
        quarter, half, three_quarters = self.updates[0, :QUARTERS].tolist()
        return quarter, half, three_quarters

    def voltages(self, u: float) -> tuple[float, ...]:
        """Return the voltages of the sample that begins with ``u`` as :meth:`step` returned it, one per update [V]."""
        quarter, half, three_quarters = self.later_voltages
        count = self.parameters.updates_per_sample
        return (u, quarter, half, three_quarters) if count == 4 else (u, half)[:count]

    def mean_voltage(self, u: float) -> float:
        """Return the mean voltage over the sample that begins with ``u`` as :meth:`step` returned it [V]."""
        return float(self.updates[0, QUARTERS]) if self.parameters.is_multirate else u

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
