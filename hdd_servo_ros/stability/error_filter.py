"""
Filter from the filtered error r to the error e: e' + lambda e + lambda_i int e dt = r.

Its transfer function is G = s/(s^2 + lambda s + lambda_i), or 1/(s + lambda) without integral action. A bound on r
gives a bound on e by the L1 norm of the impulse response g = h', where h is that of 1/(s^2 + lambda s + lambda_i). The
integral of abs(g) is the total variation of h, so only the extrema of h are needed. The same holds for e' = s G r: its
impulse response is a unit impulse plus g', and the extrema are those of g.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class ErrorFilter:
    """
    Filter from r to e, and bounds on e from bounds on r.

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
        """Whether a bounded r implies a bounded e."""
        return self.error_filter_lambda > 0.0

    @property
    def norm(self) -> float:
        """L1 norm of G [s], largest ``|e|`` over largest ``|r|``; infinity if G is unstable."""
        lambda_, lambda_i = self.error_filter_lambda, self.integral_gain
        if not self.is_stable:
            return math.inf
        if lambda_i == 0.0:
            return 1.0 / lambda_
        # h rises from 0 to its first extremum and ends at 0; each further extremum is smaller by the same ratio.
        first = abs(float(self._h(np.array([self._first_extremum]))[0]))
        return 2.0 * first / (1.0 - self._ratio)

    @property
    def rate_norm(self) -> float:
        """L1 norm of s G, largest ``|e'|`` over largest ``|r|``; infinity if G is unstable."""
        if not self.is_stable:
            return math.inf
        if self.integral_gain == 0.0:
            return 2.0
        # g falls from 1 to its first extremum, which comes at twice the time of that of h, and ends at 0.
        first = abs(float(self._g(np.array([2.0 * self._first_extremum]))[0]))
        return 2.0 + 2.0 * first / (1.0 - self._ratio)

    def initial_size(self, error: float, integral: float) -> float:
        """
        Return a bound on the free response of the error [um]: e^2 + lambda_i (int e dt)^2 does not increase.

        Parameters
        ----------
        error, integral
            Initial e [um] and its integral [um s].
        """
        return math.hypot(error, math.sqrt(self.integral_gain) * integral)

    def largest_rate(self, initial_size: float) -> float:
        """Return a bound on the free response of e' [um/s], given the :meth:`initial_size` [um]."""
        return math.hypot(self.error_filter_lambda, math.sqrt(self.integral_gain)) * initial_size

    def error_over(self, time: Array, limit: Array, error: float, integral: float) -> Array:
        """
        Return the bound on ``|e|`` over time [um], shape (N,).

        In each sample, ``|r|`` is bounded by the larger of its bounds at both ends.

        Parameters
        ----------
        time
            Equally spaced times [s], shape (N,).
        limit
            Bound on ``|r|`` at these times [um/s], monotonic.
        error, integral
            e [um] and its integral [um s] at the first time.
        """
        # Imported late: scipy.signal takes longer to import than a run takes to start.
        from scipy.signal import fftconvolve

        if not self.is_stable:
            return np.full(len(time), math.inf)
        t = time - time[0]
        free = np.abs(error * self._g(t) - self.integral_gain * integral * self._h(t))
        variation = self._variation(t)
        forced = (
            fftconvolve(variation, np.maximum(limit[1:], limit[:-1]))[: len(variation)] if len(variation) else variation
        )
        bound: Array = free + np.concatenate(([0.0], forced))
        return bound

    def _variation(self, t: Array) -> Array:
        """Return the integral of ``|g|`` over each interval between the times, shape (N - 1,)."""
        if self.integral_gain == 0.0:
            values: Array = np.diff(-np.exp(-self.error_filter_lambda * t)) / self.error_filter_lambda
            return values
        extrema = np.array([self._first_extremum])
        if self._is_oscillating:
            extrema = np.arange(self._first_extremum, t[-1], self._half_period)
        times = np.sort(np.concatenate((t, extrema[extrema < t[-1]])))
        variation = np.abs(np.diff(self._h(times)))
        cells = np.searchsorted(t, times[:-1], side='right') - 1
        found: Array = np.bincount(cells, weights=variation, minlength=len(t) - 1).astype(np.float64)
        return found[: len(t) - 1]

    @property
    def _is_oscillating(self) -> bool:
        return self.error_filter_lambda**2 < 4.0 * self.integral_gain

    @property
    def _half_period(self) -> float:
        """Time between two extrema of h [s], if the filter oscillates."""
        return math.pi / math.sqrt(self.integral_gain - 0.25 * self.error_filter_lambda**2)

    @property
    def _ratio(self) -> float:
        """Ratio of two successive extrema; 0 if the filter does not oscillate."""
        if not self._is_oscillating:
            return 0.0
        return math.exp(-0.5 * self.error_filter_lambda * self._half_period)

    @property
    def _first_extremum(self) -> float:
        """Time of the first extremum of h [s]."""
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
        """Negative poles [1/s], the slower one first."""
        a = 0.5 * self.error_filter_lambda
        root = complex(a * a - self.integral_gain) ** 0.5
        fast = a + root
        # Avoids the cancellation of a difference where lambda_i is small.
        return (self.integral_gain / fast if root.imag == 0.0 else a - root), fast
