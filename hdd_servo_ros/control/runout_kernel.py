"""Compiled steps of the cancellation of repeatable runout; see :mod:`hdd_servo_ros.control.runout`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics.compiled import compiled, compiled_apart
from hdd_servo_ros.numerics.elementary import sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record

Array = NDArray[np.float64]

HARMONICS, REPETITIVE = 1.0, 2.0

CONSTANTS = layout(
    'method',
    'acts',
    'learns',
    'samples',
    'turns_per_sample',
    'gain',
    'initial_gain',
    'first_tick',
    'error_limit',
    'control_limit',
)
"""
``samples`` per revolution, 0 if it is not an integer; gains per revolution; ``first_tick`` of learning.
"""

STATE = layout('offset', 'learned', 'square', 'limited_left')
"""
Offset of the delay line, number of samples learned by harmonics, sum of squares over a revolution [V^2], remaining
samples for which it counts as limited.
"""

ESTIMATES = layout('u_rro', 'rro_rms', 'rro_gain')

ORDER, SINE, COSINE, SCALE, U_COSINE, U_SINE = range(6)
"""
Rows of the array of harmonics: order, sine and cosine of the phase of the response there, 2 over its magnitude and over
the samples per revolution [V/um], coefficients a and b of the cancellation [V].
"""
MEAN, COUNT, LEARNED, LEARNED_AGAIN, FILTER, PARTS = range(6)
"""
Parts of the array of sectors, each one revolution long: mean error without the cancellation [um], number of averaged
revolutions, mean at the start of the revolution, stored twice in a row, and the learning filter [V/um], reversed; then
the number of parts.
"""


class RunoutArrays(NamedTuple):
    """Array arguments of :func:`runout_step` that precede its inputs."""

    constants: Array
    state: Array
    harmonics: Array
    """Shape (6, orders)."""
    sectors: Array
    """Shape (PARTS N,)."""
    path: Array
    """Response of the error to a pulse of the cancellation, from the next sample on [um/V], shape (N,)."""
    line: Array
    """The last N values of the cancellation [V], twice in a row, shape (2 N,)."""
    estimates: Array


@compiled_apart
def runout_step(
    constants: Array,
    state: Array,
    harmonics: Array,
    sectors: Array,
    path: Array,
    line: Array,
    estimates: Array,
    tick: int,
    error: float,
) -> float:
    """Return the cancellation [V]; see :meth:`hdd_servo_ros.control.runout.RunoutCancellation.step`."""
    c = record(constants, CONSTANTS)
    s = record(state, STATE)
    if not abs(error) < math.inf:
        return math.nan
    learns = c.learns != 0.0 and float(tick) >= c.first_tick
    s.limited_left = max(s.limited_left - 1.0, 0.0)
    if c.method == HARMONICS:
        output = _harmonics(c, s, harmonics, estimates, tick, error, learns)
    else:
        output = _repetitive(c, s, sectors, path, line, estimates, tick, error, learns)
    if abs(output) > c.control_limit:
        output = min(max(output, -c.control_limit), c.control_limit)
        s.limited_left = 1.0 / c.turns_per_sample
    if c.acts == 0.0:
        output = 0.0
    if c.method == REPETITIVE:
        offset = int(s.offset) - 1 if s.offset > 0.0 else len(path) - 1
        s.offset = float(offset)
        line[offset] = output
        line[offset + len(path)] = output
    record(estimates, ESTIMATES).u_rro = output
    return output


@compiled
def _harmonics(
    c: np.record, s: np.record, harmonics: Array, estimates: Array, tick: int, error: float, learns: bool
) -> float:
    """Return the sum of the harmonics after the correction of this sample [V]."""
    if c.samples > 0.0:
        # Exactly the same value in every revolution.
        turns = float(tick % int(c.samples)) / c.samples
    else:
        turns = float(tick) * c.turns_per_sample
    step = 0.0
    if learns:
        # With the gain 2/(2 + t) the remaining error decreases as 1/t^2.
        gain = max(min(2.0 / (2.0 + s.learned * c.turns_per_sample), c.initial_gain), c.gain)
        s.learned += 1.0
        record(estimates, ESTIMATES).rro_gain = gain
        step = gain * min(max(error, -c.error_limit), c.error_limit)
    total, square = 0.0, 0.0
    for i in range(harmonics.shape[1]):
        sine, cosine = sine_cosine_of_turns(harmonics[ORDER, i] * turns)
        a, b = harmonics[U_COSINE, i], harmonics[U_SINE, i]
        if step != 0.0:
            # Cosine and sine of n theta + phi_n.
            a -= step * harmonics[SCALE, i] * (cosine * harmonics[COSINE, i] - sine * harmonics[SINE, i])
            b -= step * harmonics[SCALE, i] * (sine * harmonics[COSINE, i] + cosine * harmonics[SINE, i])
            size = math.sqrt(a * a + b * b)
            if size > c.control_limit:
                a *= c.control_limit / size
                b *= c.control_limit / size
                s.limited_left = 1.0 / c.turns_per_sample
            harmonics[U_COSINE, i], harmonics[U_SINE, i] = a, b
        total += a * cosine + b * sine
        square += a * a + b * b
    record(estimates, ESTIMATES).rro_rms = math.sqrt(0.5 * square)
    return total


@compiled
def _repetitive(
    c: np.record,
    s: np.record,
    sectors: Array,
    path: Array,
    line: Array,
    estimates: Array,
    tick: int,
    error: float,
    learns: bool,
) -> float:
    """Return the value of this sector [V], from the mean errors up to the end of the last revolution."""
    count = len(path)
    sector = tick % count
    if sector == 0:
        record(estimates, ESTIMATES).rro_rms = math.sqrt(s.square / float(count))
        s.square = 0.0
        for i in range(count):
            sectors[LEARNED * count + i] = sectors[MEAN * count + i]
            sectors[LEARNED_AGAIN * count + i] = sectors[MEAN * count + i]
    if learns:
        without = error - dot(path, 0, line, int(s.offset), count)
        without = min(max(without, -c.error_limit), c.error_limit)
        sectors[COUNT * count + sector] += 1.0
        gain = max(1.0 / sectors[COUNT * count + sector], c.gain)
        record(estimates, ESTIMATES).rro_gain = gain
        sectors[MEAN * count + sector] += gain * (without - sectors[MEAN * count + sector])
    output = -dot(sectors, FILTER * count, sectors, LEARNED * count + sector, count)
    s.square += output * output
    return output


@compiled_apart
def dot(left: Array, first: int, right: Array, second: int, count: int) -> float:
    """Return the sum of ``count`` products from two offsets on; four partial sums hide the latency of the additions."""
    sum_0, sum_1, sum_2, sum_3 = 0.0, 0.0, 0.0, 0.0
    fours = count - count % 4
    for i in range(0, fours, 4):
        sum_0 += left[first + i] * right[second + i]
        sum_1 += left[first + i + 1] * right[second + i + 1]
        sum_2 += left[first + i + 2] * right[second + i + 2]
        sum_3 += left[first + i + 3] * right[second + i + 3]
    for i in range(fours, count):
        sum_0 += left[first + i] * right[second + i]
    return (sum_0 + sum_1) + (sum_2 + sum_3)


@compiled_apart
def response_at(pulse: Array, turns: float) -> tuple[float, float]:
    """Return real and imaginary part of the sum of pulse[i] exp(-2 pi j turns i), with exact reduction of the angle."""
    real, imaginary = 0.0, 0.0
    for i in range(len(pulse)):
        angle = turns * float(i)
        sine, cosine = sine_cosine_of_turns(angle - np.floor(angle))
        real += pulse[i] * cosine
        imaginary -= pulse[i] * sine
    return real, imaginary


@compiled_apart
def learning_filter(pulse: Array, cutoff_order: float, taps: Array) -> None:
    """
    Fill ``taps`` with the periodic inverse of a pulse response and a zero-phase low pass.

    Tap i is the sum over the orders k of (Q_k/H_k) exp(2 pi j k i/N)/N with H_k the response at k/N turns per sample.
    Order 0 is omitted, since the controller's integral cancels the mean, and so is half the sampling frequency.

    Parameters
    ----------
    pulse
        Pulse response [um/V], shape (p,).
    cutoff_order
        Order at which Q is 0.5; 0 for Q = 1.
    taps
        Output array of the filter [V/um], shape (N,).
    """
    count = len(taps)
    for i in range(count):
        taps[i] = 0.0
    for k in range(1, (count + 1) // 2):
        real, imaginary = response_at(pulse, float(k) / float(count))
        square = real * real + imaginary * imaginary
        if not square > 0.0:
            continue
        ratio = float(k) / cutoff_order if cutoff_order > 0.0 else 0.0
        ratio *= ratio
        ratio *= ratio
        scale = 2.0 / (float(count) * square * (1.0 + ratio * ratio))
        for i in range(count):
            sine, cosine = sine_cosine_of_turns(float((k * i) % count) / float(count))
            # Real part of exp(j angle) times the conjugate of H.
            taps[i] += scale * (real * cosine + imaginary * sine)
