"""Largest gains and largest lambda that keep the peak sensitivity of a loop."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LinearController, LoopMargins
from hdd_servo_ros.parameters import ParameterError

LEAST_LAMBDA = 5.0
"""Smallest lambda for the start of the search for a gain [1/s]."""
DAMPING_RATIO = 0.5**0.5
"""Smallest damping ratio of the rigid head in the loop, below which the loop rings because of low gain."""
EDGE = 0.01
"""Relative reduction of the largest k_p by a peak between two frequencies of the grid."""
ACCURACY = 1e-6
"""Relative tolerance of the largest k_p."""
_SECANTS = 5
"""Largest number of secants in the search."""


def round_down(value: float, digits: int = 3) -> float:
    """Return ``value`` > 0 rounded toward zero to significant digits, which keeps an upper bound."""
    scale = digits - 1 - math.floor(math.log10(value))
    return float(f'{math.floor(value * 10**scale + 1e-9) / 10**scale:.{digits}g}')


def round_up(value: float, digits: int = 3) -> float:
    """Return ``value`` > 0 rounded up to significant digits."""
    down = round_down(value, digits)
    return down if down >= value else float(f'{down + 10.0 ** (math.floor(math.log10(value)) - digits + 1):.{digits}g}')


def largest(allowed: Callable[[float], bool], start: float, factor: float = 1.1) -> float:
    """Return the largest value up to which ``allowed`` holds, stepping up from ``start``; 0 if it fails there."""
    if not allowed(start):
        return 0.0
    while allowed(start * factor):
        start *= factor
    low, high = start, start * factor
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


def largest_gain_on_r(
    margins: LoopMargins,
    error_filter_lambda: float,
    integral_gain: float = 0.0,
    delay: int = 0,
    damping_ratio: float = DAMPING_RATIO,
) -> float:
    """
    Return the largest g [V s/um] of u = -g r that keeps Ms <= 2.

    Parameters
    ----------
    margins
        The drive and the sample time.
    error_filter_lambda, integral_gain
        lambda [1/s] and lambda_i [1/s^2] of r.
    delay
        Samples by which u comes late.
    damping_ratio
        Smallest damping ratio of the rigid head in the loop.

    Raises
    ------
    ParameterError
        If no gain does, because lambda is too large for this drive and sample time.
    """

    def allowed(g: float) -> bool:
        return _keeps_the_rule(margins, g, error_filter_lambda, integral_gain, delay)

    g = largest(allowed, _least_gain_on_r(margins, error_filter_lambda, damping_ratio))
    if g == 0.0:
        reach = largest_lambda(margins, error_filter_lambda, integral_gain, delay, damping_ratio)
        allowed_lambda = f'at most {reach:g}, the largest with which some gain gives Ms <= {MAX_SENSITIVITY:g} [1/s]'
        raise ParameterError('error_filter_lambda', error_filter_lambda, allowed_lambda)
    return g


def largest_lambda(
    margins: LoopMargins,
    error_filter_lambda: float,
    integral_gain: float = 0.0,
    delay: int = 0,
    damping_ratio: float = DAMPING_RATIO,
) -> float:
    """
    Return the largest lambda [1/s] up to a given one for which some gain on r keeps Ms <= 2.

    lambda_i scales with its square, so that the poles of the error filter keep their damping. A reduced lambda is
    rounded down to three digits.

    Parameters
    ----------
    margins, error_filter_lambda, integral_gain, delay, damping_ratio
        See :func:`largest_gain_on_r`.

    Raises
    ------
    ParameterError
        If no lambda does, because the sample time is too long for this drive.
    """

    def allowed(value: float) -> bool:
        integral = scaled_integral_gain(integral_gain, error_filter_lambda, value)
        return _keeps_the_rule(margins, _least_gain_on_r(margins, value, damping_ratio), value, integral, delay)

    if allowed(error_filter_lambda):
        return error_filter_lambda
    high, low = error_filter_lambda, 0.5 * error_filter_lambda
    while not allowed(low):
        if low < LEAST_LAMBDA:
            raise ParameterError(
                'sample_time',
                margins.sample_time,
                f'a shorter one: no error_filter_lambda has a gain with Ms <= {MAX_SENSITIVITY:g} on this drive [s]',
            )
        high, low = low, 0.5 * low
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return round_down(low)


def scaled_integral_gain(integral_gain: float, given_lambda: float, used_lambda: float) -> float:
    """Return lambda_i [1/s^2] for another lambda [1/s] that keeps the damping of the error filter."""
    return integral_gain * (used_lambda / given_lambda) ** 2


def _keeps_the_rule(
    margins: LoopMargins, g: float, error_filter_lambda: float, integral_gain: float, delay: int
) -> bool:
    law = LinearController.on_r(g, error_filter_lambda, integral_gain, delay)
    return margins.peak_sensitivity(law, MAX_SENSITIVITY) <= MAX_SENSITIVITY


def _least_gain_on_r(margins: LoopMargins, error_filter_lambda: float, damping_ratio: float) -> float:
    """Return 4 zeta^2 lambda m, which gives the loop s^2 + g s/m + g lambda/m of the rigid head damping zeta."""
    return 4.0 * damping_ratio**2 * max(error_filter_lambda, LEAST_LAMBDA) / margins.rigid_gain


def largest_proportional_gain(margins: LoopMargins, law: LinearController) -> float:
    """
    Return the largest k_p [V/um] that keeps Ms <= 2 with the other gains of ``law``; 0 if no k_p does.

    At each frequency ``|1 + L| >= 1/Ms`` is a quadratic inequality in k_p, which excludes the interval between its
    roots. The remaining k_p form intervals, in each of which the loop is either always or never stable.

    Parameters
    ----------
    margins
        The drive and the sample time.
    law
        The controller with k_d, its filter, k_i and the delay.
    """
    unit = LinearController(1.0, 0.0, delay=law.delay).response_at(margins.on_circle, margins.sample_time)
    rest = dataclasses.replace(law, proportional=0.0).response_at(margins.on_circle, margins.sample_time)
    lows, highs = [], []
    for response in margins.responses:
        slope, start = (unit * response).sum(axis=1), 1.0 + (rest * response).sum(axis=1)
        square, middle = np.abs(slope) ** 2, -(np.conj(slope) * start).real
        root = middle**2 - square * (np.abs(start) ** 2 - MAX_SENSITIVITY**-2)
        square, middle, root = (values[root > 0.0] for values in (square, middle, root))
        lows.append((middle - np.sqrt(root)) / square)
        highs.append((middle + np.sqrt(root)) / square)
    low, high = np.concatenate(lows), np.concatenate(highs)
    order = np.argsort(low)
    low, covered = low[order], np.maximum.accumulate(high[order])
    ends = low[np.concatenate([[True], low[1:] > covered[:-1]])]
    # Try the upper end of each remaining interval, starting with the highest.
    for end in ends[ends > 0.0][::-1]:
        proportional = _last_below(
            lambda value, limit: margins.peak_sensitivity(dataclasses.replace(law, proportional=value), limit),
            float(end),
        )
        if proportional > 0.0:
            return proportional
    return 0.0


def _last_below(peak: Callable[[float, float], float], end: float) -> float:
    """
    Return the largest k_p just below ``end`` with Ms <= 2; 0 if no k_p has it.

    ``peak`` returns Ms for a k_p, or any value above a limit if Ms is above that limit.
    """
    # The end follows from the frequency grid; a peak between two frequencies reduces it slightly.
    for gap in (1e-9, EDGE):
        below = peak(end * (1.0 - gap), MAX_SENSITIVITY)
        if below <= MAX_SENSITIVITY:
            break
    else:
        return 0.0
    low, high = end * (1.0 - gap), end
    if high - low <= ACCURACY * end:
        return low
    allowed = _Crossing(peak, low, below, high)
    while high - low > ACCURACY * end:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


class _Crossing:
    """
    Test of Ms <= 2 for a k_p in a range that includes the crossing.

    Ms rises over the range, so that a result for one k_p also holds for all lower or all higher ones. The crossing is
    found first by secants, which need fewer values of Ms than bisection; the last two values are next to it.

    Parameters
    ----------
    peak
        See :func:`_last_below`.
    low, below, high
        The lower end, Ms there, and the upper end.
    """

    def __init__(self, peak: Callable[[float, float], float], low: float, below: float, high: float) -> None:
        self._peak = peak
        self._low, self._high = low, high
        # The smallest distance of L from -1, which is 1/Ms, is nearly linear in k_p.
        before, after = (low, 1.0 / below), (high, 1.0 / peak(high, math.inf))
        next_to_it = 0.5 * ACCURACY * high
        for _ in range(_SECANTS):
            if before[1] == after[1]:
                return
            guess = after[0] + (1.0 / MAX_SENSITIVITY - after[1]) * (after[0] - before[0]) / (after[1] - before[1])
            if not self._low < guess < self._high:
                return
            if abs(guess - after[0]) < next_to_it:
                break
            before, after = after, (guess, 1.0 / peak(guess, math.inf))
            self._note(guess, after[1] >= 1.0 / MAX_SENSITIVITY)
        for value in (after[0] - next_to_it, after[0] + next_to_it):
            self(value)

    def __call__(self, value: float) -> bool:
        """Return whether a k_p has Ms <= 2."""
        if self._low < value < self._high:
            self._note(value, self._peak(value, MAX_SENSITIVITY) <= MAX_SENSITIVITY)
        return value <= self._low

    def _note(self, value: float, keeps: bool) -> None:
        if keeps:
            self._low = max(self._low, value)
        else:
            self._high = min(self._high, value)
