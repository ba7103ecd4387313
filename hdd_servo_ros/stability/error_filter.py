"""
The filter that makes the error of the filtered error: e' + lambda e + lambda_i int e dt = r.

From r to e it is G = s/(s^2 + lambda s + lambda_i), which is 1/(s + lambda) without integral action. A bound of r gives
one of e by the L1 norm of its impulse response g = h', with h that of 1/(s^2 + lambda s + lambda_i). The integral of
abs(g) is the way that h goes up and down, so only the turning points of h are needed. The same holds for e' = s G r:
its impulse response is a unit impulse and g', and the turning points are those of g.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class ErrorFilter:
    """
    The filter from r to e, and bounds of e from those of r.

    Attributes
    ----------
    error_filter_lambda
        lambda [1/s].
    integral_gain
        lambda_i [1/s^2]; 0 without integral action.
    """

    error_filter_lambda: float
    integral_gain: float = 0.0

    @property
    def is_stable(self) -> bool:
        """Whether e is bounded where r is."""
        return self.error_filter_lambda > 0.0

    @property
    def norm(self) -> float:
        """The L1 norm of G [s], largest |e| over largest |r|; infinity if G is not stable."""
        lambda_, lambda_i = self.error_filter_lambda, self.integral_gain
        if not self.is_stable:
            return math.inf
        if lambda_i == 0.0:
            return 1.0 / lambda_
        # h rises from 0 to its first turn and ends at 0; under-damped, each turn is that part of the one before.
        first = abs(float(self._h(np.array([self._first_turn]))[0]))
        return 2.0 * first / (1.0 - self._share)

    @property
    def rate_norm(self) -> float:
        """The L1 norm of s G, largest |e'| over largest |r|; infinity if G is not stable."""
        if not self.is_stable:
            return math.inf
        if self.integral_gain == 0.0:
            return 2.0
        # g falls from 1 to its first turn, which comes after twice the time that h takes to its own, and ends at 0.
        first = abs(float(self._g(np.array([2.0 * self._first_turn]))[0]))
        return 2.0 + 2.0 * first / (1.0 - self._share)

    def initial_size(self, error: float, integral: float) -> float:
        """
        Return a bound of the error's free part [um]: e^2 + lambda_i (int e dt)^2 does not grow.

        Parameters
        ----------
        error, integral
            e [um] and its integral [um s] at the start.
        """
        return math.hypot(error, math.sqrt(self.integral_gain) * integral)

    def largest_rate(self, initial_size: float) -> float:
        """Return a bound of the free part of e' [um/s] for a size of :meth:`initial_size` [um]."""
        return math.hypot(self.error_filter_lambda, math.sqrt(self.integral_gain)) * initial_size

    def error_over(self, time: Array, limit: Array, error: float, integral: float) -> Array:
        """
        Return the bound of |e| over time [um], shape (N,).

        Over each sample |r| counts with the larger of its bounds at both ends.

        Parameters
        ----------
        time
            Equally spaced times [s], shape (N,).
        limit
            Bound of |r| at these times [um/s], monotonic.
        error, integral
            e [um] and its integral [um s] at the first time.
        """
        # scipy.signal takes longer to import than a run needs to begin.
        from scipy.signal import fftconvolve

        if not self.is_stable:
            return np.full(len(time), math.inf)
        t = time - time[0]
        free = np.abs(error * self._g(t) - self.integral_gain * integral * self._h(t))
        ways = self._ways(t)
        forced = fftconvolve(ways, np.maximum(limit[1:], limit[:-1]))[: len(ways)] if len(ways) else ways
        bound: Array = free + np.concatenate(([0.0], forced))
        return bound

    def _ways(self, t: Array) -> Array:
        """Return the integral of |g| over each interval between the times, shape (N - 1,)."""
        if self.integral_gain == 0.0:
            values: Array = np.diff(-np.exp(-self.error_filter_lambda * t)) / self.error_filter_lambda
            return values
        turns = np.array([self._first_turn])
        if self._is_oscillating:
            turns = np.arange(self._first_turn, t[-1], self._half_period)
        times = np.sort(np.concatenate((t, turns[turns < t[-1]])))
        ways = np.abs(np.diff(self._h(times)))
        cells = np.searchsorted(t, times[:-1], side='right') - 1
        found: Array = np.bincount(cells, weights=ways, minlength=len(t) - 1).astype(np.float64)
        return found[: len(t) - 1]

    @property
    def _is_oscillating(self) -> bool:
        return self.error_filter_lambda**2 < 4.0 * self.integral_gain

    @property
    def _half_period(self) -> float:
        """Time from a turn of h to the next [s], of an oscillating filter."""
        return math.pi / math.sqrt(self.integral_gain - 0.25 * self.error_filter_lambda**2)

    @property
    def _share(self) -> float:
        """Size of a turn over that of the one before; 0 of a filter that does not oscillate."""
        if not self._is_oscillating:
            return 0.0
        return math.exp(-0.5 * self.error_filter_lambda * self._half_period)

    @property
    def _first_turn(self) -> float:
        """Time of the first turn of h [s]."""
        a = 0.5 * self.error_filter_lambda
        square = self.integral_gain - a * a
        if square > 0.0:
            return math.atan2(math.sqrt(square), a) / math.sqrt(square)
        slow, fast = self._rates
        difference = (fast - slow).real
        return math.log1p(difference / slow.real) / difference if difference > 0.0 else 1.0 / a

    def _h(self, t: Array) -> Array:
        """Return the impulse response of 1/(s^2 + lambda s + lambda_i) [s]."""
        slow, fast = self._rates
        if slow == fast:
            values: Array = t * np.exp(-slow.real * t)
            return values
        responses: Array = (-np.exp(-slow * t) * np.expm1((slow - fast) * t) / (fast - slow)).real
        return responses

    def _g(self, t: Array) -> Array:
        """Return the impulse response of G, h'."""
        slow, fast = self._rates
        if slow == fast:
            values: Array = (1.0 - slow.real * t) * np.exp(-slow.real * t)
            return values
        responses: Array = (
            np.exp(-fast * t) + slow * np.exp(-slow * t) * np.expm1((slow - fast) * t) / (fast - slow)
        ).real
        return responses

    @property
    def _rates(self) -> tuple[complex, complex]:
        """The poles' negatives [1/s], the slower one first."""
        a = 0.5 * self.error_filter_lambda
        root = complex(a * a - self.integral_gain) ** 0.5
        fast = a + root
        # The difference would cancel where lambda_i is small.
        return (self.integral_gain / fast if root.imag == 0.0 else a - root), fast
