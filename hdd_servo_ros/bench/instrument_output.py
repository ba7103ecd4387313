"""The output of an instrument as its converter reads it: clipped to a range, rounded to a step, clipping counted."""

import math

import numpy as np

from hdd_servo_ros.bench.converter import beyond_codes, converted
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.records import layout

OUTPUT = layout('range', 'step', 'lowest', 'highest')
"""Largest magnitude [V], 0 for none; step [V], lowest and highest code of the converter."""

OVERRANGE = layout('samples', 'first_tick')
"""How many samples of an output were clipped, and the tick of the first."""


@compiled
def read_output(output: np.record, overrange: np.record, tick: int, volts: float) -> float:
    """
    Return an output as the converter reads it [V].

    Parameters
    ----------
    output
        A record of :data:`OUTPUT`.
    overrange
        A record of :data:`OVERRANGE`, which counts.
    tick
        The tick.
    volts
        The output before its limits [V]; what is not finite passes through.
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
