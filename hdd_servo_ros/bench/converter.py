"""Ideal bipolar converter with 2^bits codes, for the ADCs of the sensors and the DAC of the DSP."""

import math

import numpy as np

from hdd_servo_ros.numerics.compiled import compiled


@compiled
def converted(volts: float, step: float, lowest: float, highest: float) -> float:
    """
    Return the converted voltage: rounded to the step and clipped to the lowest and highest code.

    The voltage must be finite. Half a step rounds up, so positive and negative voltages are symmetric except for exact
    ties. ``step`` = 0 is an ideal converter.
    """
    if step > 0.0:
        code = np.floor(volts / step + 0.5)
        return min(max(code, lowest), highest) * step  # type: ignore[no-any-return]
    return volts


@compiled
def beyond_codes(volts: float, step: float, lowest: float, highest: float) -> bool:
    """Return whether the converter clips a voltage."""
    if step > 0.0:
        code = np.floor(volts / step + 0.5)
        return code < lowest or code > highest  # type: ignore[no-any-return]
    return False


def converter_codes(bits: int, full_scale: float) -> tuple[float, float, float]:
    """
    Return step [V], lowest and highest code of a converter.

    Parameters
    ----------
    bits
        Resolution; 0 is an ideal converter, with step 0 and no lowest or highest code.
    full_scale
        Range of the converter, -full_scale to +full_scale [V]; the highest code is one step below +full_scale.
    """
    if bits == 0:
        return 0.0, -math.inf, math.inf
    codes = 2.0 ** (bits - 1)
    return full_scale / codes, -codes, codes - 1.0
