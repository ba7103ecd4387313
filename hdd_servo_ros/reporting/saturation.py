"""What a bag tells of saturation: the samples that lie at the end of what an instrument can give."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.bench.converter import converter_codes
from hdd_servo_ros.bench.ldv import OUTPUTS, LdvParameters
from hdd_servo_ros.messages.signals import Signals
from hdd_servo_ros.parameters import declarations, from_mapping
from hdd_servo_ros.recording.recorded_run import RecordedRun


def saturated_ticks(signals: Signals | RecordedRun, run: Mapping[str, Any]) -> dict[str, NDArray[np.int64]]:
    """
    Find the samples that an instrument has clipped.

    Parameters
    ----------
    signals
        From :func:`read_signals`, or the run itself.
    run
        Content of ``run.yaml``; the parameters are those at the start of the run.

    Returns
    -------
    dict
        Of the vibrometer's displacement and velocity output and of the drive voltage, where any were: their ticks.
    """
    clipped: dict[str, NDArray[np.bool_]] = {}
    for name, node in run.get('nodes', {}).items():
        parameters = node.get('parameters', {})
        if name.rpartition('/')[2] == 'ldv_sensor':
            known = {declaration.name for declaration in declarations(LdvParameters)} & parameters.keys()
            lowest, highest = from_mapping(LdvParameters, {key: parameters[key] for key in known}).levels()
            for output, volts in zip(OUTPUTS, signals.ldv.T, strict=False):
                clipped[f'{output} output'] = (volts <= lowest) | (volts >= highest)
        elif 'dsp.dac_bits' in parameters:
            # Rounding to the converter's step is no saturation.
            step, _, _ = converter_codes(parameters['dsp.dac_bits'], parameters['dsp.dac_range'])
            clipped['control'] = np.abs(signals.control[:, 1]) > np.abs(signals.control[:, 0]) + step
    return {name: np.flatnonzero(where) for name, where in clipped.items() if where.any()}


def saturation_of(run: RecordedRun) -> dict[str, NDArray[np.int64]] | None:
    """Return :func:`saturated_ticks` of a run, None if the bag or its ``run.yaml`` do not tell."""
    if not run.description or 'ldv' not in run or 'control' not in run:
        return None
    return saturated_ticks(run, run.description)


def saturation_line(signals: Signals | RecordedRun, run: Mapping[str, Any]) -> str:
    """Return in one line which signals were clipped, how often and from which tick on; empty if none was."""
    return in_one_line(saturated_ticks(signals, run), len(signals.time))


def in_one_line(clipped: Mapping[str, NDArray[np.int64]], samples: int) -> str:
    """Return what :func:`saturated_ticks` has found in a run of so many samples."""
    return '; '.join(
        f'{name} {len(ticks)} of {samples} samples, first at tick {ticks[0]}' for name, ticks in clipped.items()
    )
