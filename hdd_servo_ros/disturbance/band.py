"""
Steep band-pass filter: Butterworth low-pass and high-pass filters as digital sections, scaled to a given variance.

With W = tan(pi f T), the bilinear transform with prewarped edge frequencies gives::

    |H(f)|^2 = 1/(1 + (W/W_high)^(2 n)) * 1/(1 + (W_low/W)^(2 m)),

where n is the order of the low-pass filter and m that of the high-pass filter. All coefficients come from the
elementary functions of this package, so they are identical on every machine.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.elementary import TWO_PI, exp, log, sine_cosine_of_turns
from hdd_servo_ros.numerics.noise import normal_pair
from hdd_servo_ros.numerics.records import layout, record

SECTION = layout('b0', 'b1', 'b2', 'a1', 'a2')
"""Section (b0 + b1 z^-1 + b2 z^-2)/(1 + a1 z^-1 + a2 z^-2)."""

_NATS = 40.0
"""Integrands below exp(-40) of the largest are neglected."""
_RUN_IN_DECAY = 16.0
"""Before tick 0 the filter runs until its slowest oscillation has decayed to exp(-16)."""


def warped(frequency: float, sample_time: float) -> float:
    """Return the prewarped frequency tan(pi f T) of a frequency f [Hz] at sample time T [s]."""
    sine, cosine = sine_cosine_of_turns(0.5 * frequency * sample_time)
    return sine / cosine


def band_sections(low: float, high: float, low_order: int, high_order: int, sample_time: float) -> NDArray[np.float64]:
    """
    Return the sections of a band-pass filter, high pass first, shape (n, 5), one row of layout :data:`SECTION` each.

    Parameters
    ----------
    low, high
        Edge frequencies at half power [Hz]; no high pass if ``low`` is 0.
    low_order, high_order
        Order of the high pass at the low edge, and of the low pass at the high edge.
    sample_time
        T [s].
    """
    rows = [_low_pass(damping, warped(high, sample_time)) for damping in _dampings(high_order)]
    if low > 0.0:
        rows = [_high_pass(damping, warped(low, sample_time)) for damping in _dampings(low_order)] + rows
    return np.array(rows)


def _dampings(order: int) -> list[float]:
    """Return 2 z for each pair of Butterworth poles s^2 + 2 z s + 1, and 0 for the real pole of an odd order."""
    pairs = [2.0 * sine_cosine_of_turns((2 * k + 1) / (4.0 * order))[0] for k in range(order // 2)]
    # Lightly damped sections, which amplify near the edge, come last.
    return ([0.0] if order % 2 else []) + sorted(pairs, reverse=True)


def _low_pass(damping: float, edge: float) -> tuple[float, ...]:
    if damping == 0.0:
        gain = edge / (1.0 + edge)
        return gain, gain, 0.0, (edge - 1.0) / (edge + 1.0), 0.0
    square = edge * edge
    divisor = 1.0 + damping * edge + square
    gain = square / divisor
    return gain, 2.0 * gain, gain, 2.0 * (square - 1.0) / divisor, (1.0 - damping * edge + square) / divisor


def _high_pass(damping: float, edge: float) -> tuple[float, ...]:
    if damping == 0.0:
        gain = 1.0 / (1.0 + edge)
        return gain, -gain, 0.0, (edge - 1.0) / (edge + 1.0), 0.0
    square = edge * edge
    divisor = 1.0 + damping * edge + square
    gain = 1.0 / divisor
    return gain, -2.0 * gain, gain, 2.0 * (square - 1.0) / divisor, (1.0 - damping * edge + square) / divisor


def band_power(low: float, high: float, low_order: int, high_order: int, sample_time: float) -> float:
    """
    Return the variance of filtered white noise of variance 1: the mean of ``|H|^2``.

    With u = log tan(pi f T) the mean over all frequencies is an integral over the whole axis. The integrand is smooth
    and decays at both ends, so the trapezoidal rule is exact to rounding.
    """
    upper = log(warped(high, sample_time))
    # Without a high pass, W itself limits the integrand at low frequency.
    has_low = low > 0.0
    lower = log(warped(low, sample_time)) if has_low else -math.inf
    first = lower - _NATS / (2 * low_order + 1) if has_low else min(upper, 0.0) - _NATS
    last = upper + _NATS / (2 * high_order)
    # The poles nearest to the axis are at pi/(2 n); the trapezoidal error is exp(-2 pi/step) to the power of that.
    steepest = max(high_order, low_order if has_low else 1)
    step = 0.5 * TWO_PI * TWO_PI / (2.0 * steepest * _NATS)
    count = math.ceil((last - first) / step)
    return 4.0 / TWO_PI * step * _power_sum(first, step, count, lower, upper, 2.0 * low_order, 2.0 * high_order)


@compiled
def _power_sum(
    first: float, step: float, count: int, lower: float, upper: float, low_slope: float, high_slope: float
) -> float:
    """Return the sum of ``|H|^2 W/(1 + W^2)`` over equally spaced u = log W."""
    total = 0.0
    for i in range(count + 1):
        u = first + float(i) * step
        w = exp(u)
        power = 1.0 / (1.0 + exp(high_slope * (u - upper)))
        power /= 1.0 + exp(low_slope * (lower - u))
        total += power * w / (1.0 + w * w)
    return total


def run_in_ticks(low: float, high: float, low_order: int, high_order: int, sample_time: float) -> int:
    """Return the run-in time of a band-pass filter, after which its start at rest has decayed [ticks]."""
    edges = [(high, high_order)] + ([(low, low_order)] if low > 0.0 else [])
    # The slowest pole of a Butterworth filter has the decay rate w sin(pi/(2 n)).
    slowest = min(TWO_PI * edge * sine_cosine_of_turns(0.25 / order)[0] for edge, order in edges)
    return math.ceil(_RUN_IN_DECAY / (slowest * sample_time))


@compiled
def filtered(sections: NDArray[np.float64], states: NDArray[np.float64], x: float) -> float:
    """Filter a sample through all sections (transposed direct form 2); advances their states, shape (n, 2)."""
    for i in range(len(sections)):
        section = record(sections, SECTION, i)
        y = section.b0 * x + states[i, 0]
        states[i, 0] = section.b1 * x - section.a1 * y + states[i, 1]
        states[i, 1] = section.b2 * x - section.a2 * y
        x = y
    return x


@compiled
def run_in(sections: NDArray[np.float64], states: NDArray[np.float64], seed: int, stream: int, ticks: int) -> None:
    """Run the sections on white noise from a separate stream."""
    for tick in range(ticks):
        filtered(sections, states, normal_pair(seed, stream, tick)[0])


def stationary_band(sections: NDArray[np.float64], seed: int, stream: int, ticks: int) -> NDArray[np.float64]:
    """Return the states of the sections after ``ticks`` ticks of white noise from a stream, shape (n, 2)."""
    states = np.zeros((len(sections), 2))
    run_in(sections, states, seed, stream, ticks)
    return states
