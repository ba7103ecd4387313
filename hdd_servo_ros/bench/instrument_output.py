"""Instrument output read by an ADC: clipped to a range, rounded to a step, with a count of the clipped samples."""

import math

import numpy as np

from hdd_servo_ros.bench.converter import beyond_codes, converted
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout

OUTPUT = layout('range', 'step', 'lowest', 'highest')
"""Output range [V], 0 for no limit; step [V], lowest and highest code of the ADC."""

OVERRANGE = layout('samples', 'first_tick')
"""Number of clipped samples of an output, and the tick of the first."""


@compiled
def read_output(output: np.record, overrange: np.record, tick: int, volts: float) -> float:
    """
    Return an output as read by the ADC [V].

    Parameters
    ----------
    output
        Record with the layout :data:`OUTPUT`.
    overrange
        Record with the layout :data:`OVERRANGE`; updated if the sample is clipped.
    tick
        Tick of the sample.
    volts
        Output before the limits [V]; non-finite values pass through.
    """
    if not abs(volts) < math.inf:
        return volts
    limit = output.range
    beyond = limit > 0.0 and abs(volts) > limit
    if limit > 0.0:
        volts = min(max(volts, -limit), limit)
    if beyond or beyond_codes(volts, output.step, output.lowest, output.highest):
        if overrange.samples == 0.0:
            overrange.first_tick = float(tick)
        overrange.samples += 1.0
    return converted(volts, output.step, output.lowest, output.highest)
