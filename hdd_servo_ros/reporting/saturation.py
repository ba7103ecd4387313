"""Saturation in a run: the samples at the limits of an instrument."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import converter_codes
from hdd_servo_ros.bench.ldv import OUTPUTS, LdvParameters
from hdd_servo_ros.graph.recorded_nodes import recorded_nodes
from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.messages.topics import CONTROL, LDV, PES
from hdd_servo_ros.parameters import declarations, from_mapping
from hdd_servo_ros.recording.recorded_run import RecordedRun

CONTROL_OUTPUT = 'control'
"""Name of the command among the saturated signals."""


FRACTION = 'fraction of a track'
"""Name of the fraction of the servo sensor among the saturated signals."""


@dataclasses.dataclass(frozen=True)
class Ranges:
    """
    Ranges of the instruments of a run, from its initial parameters.

    Attributes
    ----------
    ldv
        Lowest and highest output voltage of the vibrometer [V]; None if its parameters are unknown.
    half_track
        Largest fraction that the servo sensor decodes [um]; None if its parameters are unknown.
    control_step
        Largest difference of the command before and after saturation without clipping [V], from the rounding of the
        DAC; None if the parameters are unknown.
    """

    ldv: tuple[float, float] | None = None
    control_step: float | None = None
    half_track: float | None = None

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> 'Ranges':
        """Return the ranges from the content of ``run.yaml``."""
        ldv, control_step, half_track = None, None, None
        for name, node in recorded_nodes(description).items():
            parameters = node.get('parameters', {})
            if name == 'ldv_sensor':
                known = {declaration.name for declaration in declarations(LdvParameters)} & parameters.keys()
                ldv = from_mapping(LdvParameters, {key: parameters[key] for key in known}).levels()
            elif name == 'servo_sensor':
                half_track = 0.5 * parameters['track_pitch']
            elif 'dsp.dac_bits' in parameters:
                control_step, _, _ = converter_codes(parameters['dsp.dac_bits'], parameters['dsp.dac_range'])
        return cls(ldv, control_step, half_track)

    def saturated_rows(self, signals: Signals) -> dict[str, NDArray[np.int64]]:
        """Return the clipped rows of each clipped signal."""
        clipped: dict[str, NDArray[np.bool_]] = {}
        if self.ldv is not None and LDV.name in signals:
            lowest, highest = self.ldv
            volts = signals[LDV.name]
            # The extremes show quickly that most runs are not clipped.
            if volts.min() <= lowest or volts.max() >= highest:
                for index, output in enumerate(OUTPUTS):
                    clipped[f'{output} output'] = (volts[:, index] <= lowest) | (volts[:, index] >= highest)
        if self.half_track is not None and PES.name in signals:
            clipped[FRACTION] = np.abs(signals.pes.error) >= self.half_track
        if self.control_step is not None and CONTROL.name in signals:
            wanted, given = signals.control.before_saturation, signals.command
            excess = wanted - given
            # Written so that nan is checked too.
            if not (-self.control_step <= excess.min() and excess.max() <= self.control_step):
                clipped[CONTROL_OUTPUT] = np.abs(wanted) > np.abs(given) + self.control_step
        return {name: np.flatnonzero(where) for name, where in clipped.items() if where.any()}


def saturated_rows(signals: Signals, description: Mapping[str, Any]) -> dict[str, NDArray[np.int64]]:
    """
    Find the samples that an instrument has clipped.

    Parameters
    ----------
    signals
        The signals of the run.
    description
        Content of ``run.yaml``, with the initial parameters.

    Returns
    -------
    dict
        Clipped rows of the displacement and velocity outputs, the fraction of the servo sensor and the drive voltage,
        for those that were clipped.
    """
    return Ranges.of(description).saturated_rows(signals)


def has_saturation_data(run: RecordedRun) -> bool:
    """Return whether the bag and ``run.yaml`` suffice to detect clipping."""
    has_sensor = LDV.name in run or PES.name in run
    return bool(run.description) and has_sensor and CONTROL.name in run


def saturation_line(counts: Mapping[str, tuple[int, int]], samples: int) -> str:
    """Return a line about the clipped samples, from the count and the first tick of each signal."""
    return '; '.join(
        f'{name} {count} of {samples} samples, first at tick {tick}' for name, (count, tick) in counts.items()
    )
