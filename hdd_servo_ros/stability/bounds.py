"""
Bounds of theorem 4.1 for a known drive: V of (4.22), c1, c2, the uniform bound (i) and the ultimate bound (ii).

The proof gives V' <= -c1 V + c2, and from it

    V(t) <= (V(0) - c2/c1) e^(-c1 t) + c2/c1 <= V(0) + c2/c1                              (4.33), (4.35)

with c1 the smallest of 2k/m (printed as 2k, but V contains m r^2/2), sigma_i k_i and sigma_w/lambda_max(Gamma^-1)
(4.30), and c2 half the sum of sigma_i times the squared ideal values (4.31). Since every term of V is at most V, this
bounds r, every estimate, and the error e, which is r through a filter (:mod:`hdd_servo_ros.stability.error_filter`).
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.adaptive_nn_parameters import (
    AdaptiveNnParameters,
    MassParameters,
    PhiParameters,
    SigmaParameters,
)
from hdd_servo_ros.stability.error_filter import ErrorFilter
from hdd_servo_ros.stability.ideal_values import IdealValues

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Relative excess that is attributed to rounding: at t = 0 the bound on V equals V."""


def scalar_laws(
    parameters: AdaptiveNnParameters, ideal: IdealValues
) -> Iterator[tuple[str, SigmaParameters | MassParameters | PhiParameters, float]]:
    """Iterate over the enabled laws (4.18)-(4.20): name of the estimate, law, ideal value."""
    if parameters.sigma.enabled:
        yield 'sigma_hat', parameters.sigma, ideal.sigma
    if parameters.mass.enabled:
        yield 'm_hat', parameters.mass, ideal.mass
    if parameters.phi.enabled:
        yield 'phi_hat', parameters.phi, ideal.phi


def convergence_rates(parameters: AdaptiveNnParameters, ideal: IdealValues) -> dict[str, float]:
    """Return the rates [1/s] whose minimum is c1 (4.30), by name of the law."""
    rates = {'feedback': 2.0 * parameters.feedback_gain / ideal.mass}
    rates |= {name: law.gain * law.leakage for name, law, _ in scalar_laws(parameters, ideal)}
    if parameters.network.enabled:
        # lambda_max(Gamma^-1) = 1/min(Gamma)
        rates['network'] = min(parameters.network.gain) * parameters.network.leakage
    if parameters.compensator.enabled:
        rates['compensator'] = parameters.compensator.gain * parameters.compensator.leakage
    return rates


def residual_rate(parameters: AdaptiveNnParameters, ideal: IdealValues) -> float:
    """Return c2 of (4.31), half the sum of sigma_i times the squared ideal values."""
    total = sum(law.leakage * true**2 for _, law, true in scalar_laws(parameters, ideal))
    if parameters.network.enabled:
        total += parameters.network.leakage * float(ideal.weights @ ideal.weights)
    return 0.5 * total


def lyapunov(
    parameters: AdaptiveNnParameters,
    ideal: IdealValues,
    r: Array,
    estimates: Mapping[str, Array],
    weight_energy: Array,
) -> Array:
    """
    Return the Lyapunov function V of (4.22), shape (N,).

    Parameters
    ----------
    parameters, ideal
        The controller and the ideal values of its estimates.
    r
        Filtered error [um/s], shape (N,).
    estimates
        ``sigma_hat``, ``m_hat`` and ``phi_hat``, shape (N,) each.
    weight_energy
        Part of V from the network weights, shape (N,); see :func:`weight_energy`.
    """
    value: Array = 0.5 * ideal.mass * r**2 + weight_energy
    for name, law, true in scalar_laws(parameters, ideal):
        value += (estimates[name] - true) ** 2 / (2.0 * law.gain)
    return value


def weight_energy(
    parameters: AdaptiveNnParameters, ideal: IdealValues, weights: Array, compensator_weights: Array
) -> Array:
    """
    Return W~'Gamma^-1 W~/2, plus W_c'W_c/(2 Gamma_c) if the compensator is enabled; shape (N,).

    The ideal weights of the compensator are taken as zero: the part that it could cancel is left in phi.

    Parameters
    ----------
    parameters, ideal
        The controller and the ideal values of its estimates.
    weights, compensator_weights
        W_hat and W_c [V], shape (N, nodes) each.
    """
    energy: Array = np.zeros(len(weights))
    if parameters.network.enabled:
        gains = np.broadcast_to(np.array(parameters.network.gain), weights.shape[1:])
        energy = 0.5 * ((weights - ideal.weights) ** 2 / gains).sum(axis=1)
    if parameters.compensator.enabled:
        energy = energy + 0.5 * (compensator_weights**2).sum(axis=1) / parameters.compensator.gain
    return energy


@dataclasses.dataclass(frozen=True)
class Bounds:
    """
    Bounds of theorem 4.1.

    Attributes
    ----------
    mass
        Mass m [V s^2/um].
    error_filter
        Filter from r to e.
    c1, c2
        Constants of (4.30) [1/s] and (4.31).
    initial
        V(0).
    """

    mass: float
    error_filter: ErrorFilter
    c1: float
    c2: float
    initial: float

    @property
    def uniform(self) -> float:
        """V(0) + c2/c1, an upper bound on V (4.35)."""
        return self.initial + self.c2 / self.c1

    @property
    def ultimate(self) -> float:
        """c2/c1, the limit of the bound on V for large times (4.33)."""
        return self.c2 / self.c1

    def level(self, time: Array) -> Array:
        """Return the bound on V over time [s] (4.33)."""
        values: Array = (self.initial - self.ultimate) * np.exp(-self.c1 * time) + self.ultimate
        return values

    def r_of(self, level: float) -> float:
        """Return the bound on ``|r|`` [um/s] given V <= ``level``: (i) from ``uniform``, (ii) from ``ultimate``."""
        return math.sqrt(2.0 * level / self.mass)

    def e_of(self, level: float) -> float:
        """
        Return the bound on ``|e|`` [um] given V <= ``level``, after the initial error has decayed.

        It is the bound on ``|r|`` times the L1 norm of the filter, 1/lambda without integral action. (4.45) is this
        bound; (4.41) adds ``|e(0)|``.
        """
        return self.error_filter.norm * self.r_of(level)

    def r_over(self, time: Array) -> Array:
        """Return the bound on ``|r|`` over time (4.43) [um/s]."""
        values: Array = np.sqrt(2.0 * self.level(time) / self.mass)
        return values

    def e_over(self, time: Array, initial_error: float, initial_integral: float = 0.0) -> Array:
        """
        Return the bound on ``|e|`` over time (4.40) [um], from that on ``|r|`` (4.43), and e and its integral at first.

        Parameters
        ----------
        time
            Equally spaced times [s].
        initial_error, initial_integral
            e(0) [um], and the initial integral of e [um s].
        """
        return self.error_filter.error_over(time, self.r_over(time), initial_error, initial_integral)

    def omega(self, initial_error: float, initial_integral: float = 0.0) -> tuple[float, float]:
        """
        Return the largest ``|x - x_d|`` [um] and ``|v - x_d'|`` [um/s] that (i) allows.

        Without integral action these are ``|e(0)|`` + R/lambda and lambda ``|e(0)|`` + 2 R, where R bounds ``|r|`` (i).

        Parameters
        ----------
        initial_error, initial_integral
            e(0) [um], and the initial integral of e [um s].
        """
        own = self.error_filter
        largest_r = self.r_of(self.uniform)
        size = own.initial_size(initial_error, initial_integral)
        return size + own.norm * largest_r, own.largest_rate(size) + own.rate_norm * largest_r


def theorem_bounds(parameters: AdaptiveNnParameters, ideal: IdealValues, initial: float) -> Bounds:
    """Return the bounds for a controller, its ideal values and V(0)."""
    rate = min(convergence_rates(parameters, ideal).values())
    error_filter = ErrorFilter(parameters.error_filter_lambda, parameters.integral_gain)
    return Bounds(ideal.mass, error_filter, rate, residual_rate(parameters, ideal), initial)


def projection_allows(parameters: AdaptiveNnParameters, ideal: IdealValues) -> bool:
    """Return whether the projection bounds contain the ideal values; the compensator's are zero."""
    inside = all(law.minimum <= true <= law.maximum for _, law, true in scalar_laws(parameters, ideal))
    return inside and float(np.abs(ideal.weights).max()) <= parameters.network.maximum


@dataclasses.dataclass(frozen=True)
class Check:
    """
    Comparison of a signal with its bound.

    Attributes
    ----------
    name, unit
        Signal and its unit.
    tick, value, limit
        Tick with the largest ratio of signal to bound, and both values there.
    violations
        Number of ticks at which the signal exceeds its bound.
    first_violation
        Tick, value and limit of the first violation, or None.
    """

    name: str
    unit: str
    tick: int
    value: float
    limit: float
    violations: int
    first_violation: tuple[int, float, float] | None

    @property
    def margin(self) -> float:
        """Limit minus value; negative for a violation."""
        return self.limit - self.value

    @property
    def tightness(self) -> float:
        """Limit divided by value: 1 for a tight bound, 100 for a loose one."""
        return self.limit / self.value if self.value > 0.0 else math.inf


def check(name: str, unit: str, values: Array, limits: Array | float, first_tick: int = 0) -> Check:
    """
    Compare a nonnegative signal with its bound, tick by tick.

    Parameters
    ----------
    name, unit
        Signal and its unit.
    values
        Values of the signal, shape (N,).
    limits
        Its bound, a number or shape (N,).
    first_tick
        Tick of the first element.
    """
    limits = np.broadcast_to(np.asarray(limits, dtype=np.float64), values.shape)
    ratio = np.divide(values, limits, out=np.where(values > 0.0, np.inf, 0.0), where=limits > 0.0)
    at = int(np.argmax(ratio))
    over = np.flatnonzero(ratio > 1.0 + _ROUNDING)
    first = None
    if len(over):
        first = (first_tick + int(over[0]), float(values[over[0]]), float(limits[over[0]]))
    return Check(name, unit, first_tick + at, float(values[at]), float(limits[at]), len(over), first)


class CertificateMonitor:
    """
    Bound on ``|r|`` during a run; each call costs one exponential and one square root.

    V(0) follows from the first r and the initial estimates, which are parameters; nothing else is needed.

    Parameters
    ----------
    parameters
        The controller's parameters at the first tick.
    ideal
        Result of :func:`~hdd_servo_ros.stability.ideal_values.theorem_values`.
    """

    def __init__(self, parameters: AdaptiveNnParameters, ideal: IdealValues) -> None:
        self._parameters = parameters
        self._ideal = ideal
        self._start = 0.0
        self.bounds: Bounds | None = None

    def limit(self, time: float) -> float:
        """
        Return the bound on ``|r|`` [um/s] (4.43) at a time [s].

        Raises
        ------
        RuntimeError
            Before the first :meth:`margin`.
        """
        if self.bounds is None:
            raise RuntimeError('the bound is unknown before the first r')
        level = (self.bounds.initial - self.bounds.ultimate) * math.exp(-self.bounds.c1 * (time - self._start))
        return self.bounds.r_of(level + self.bounds.ultimate)

    def margin(self, time: float, r: float) -> float:
        """Return the bound on ``|r|`` minus ``|r|`` [um/s]; negative for a violation. The first call sets V(0)."""
        if self.bounds is None:
            self._start = time
            self.bounds = theorem_bounds(self._parameters, self._ideal, self._initial(r))
        return self.limit(time) - abs(r)

    def _initial(self, r: float) -> float:
        p = self._parameters
        estimates = {name: np.array([law.initial]) for name, law, _ in scalar_laws(p, self._ideal)}
        weights = np.broadcast_to(np.array(p.network.initial), (1, p.network.nodes**2))
        energy = weight_energy(p, self._ideal, weights, np.zeros((1, p.compensator.nodes**2)))
        return float(lyapunov(p, self._ideal, np.array([r]), estimates, energy)[0])
