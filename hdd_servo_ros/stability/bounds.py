"""
Bounds of theorem 4.1 for a known drive: V of (4.22), c1, c2, the uniform bound (i) and the ultimate bound (ii).

The proof gives V' <= -c1 V + c2, and from it

    V(t) <= (V(0) - c2/c1) e^(-c1 t) + c2/c1 <= V(0) + c2/c1                              (4.33), (4.35)

with c1 the smallest of 2k/m (printed 2k, but V holds m r^2/2), sigma_i k_i and sigma_w/lambda_max(Gamma^-1)
(4.30), and c2 half the sum of sigma_i times the squares of the ideal values (4.31). As every term of V is at most V,
this bounds r and every estimate, and e, which is r through a filter (:mod:`hdd_servo_ros.stability.error_filter`).
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
"""Relative excess that counts as rounding: at t = 0 the bound on V is V itself."""


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
    """Return the rates [1/s] of which c1 (4.30) is the smallest, by the parts that they belong to."""
    rates = {'feedback': 2.0 * parameters.feedback_gain / ideal.mass}
    rates |= {name: law.gain * law.leakage for name, law, _ in scalar_laws(parameters, ideal)}
    if parameters.network.enabled:
        # lambda_max(Gamma^-1) = 1/min(Gamma)
        rates['network'] = min(parameters.network.gain) * parameters.network.leakage
    if parameters.compensator.enabled:
        rates['compensator'] = parameters.compensator.gain * parameters.compensator.leakage
    return rates


def residual_rate(parameters: AdaptiveNnParameters, ideal: IdealValues) -> float:
    """Return c2 of (4.31), half the sum of sigma_i times the squares of the ideal values."""
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
    Return V of (4.22), shape (N,).

    Parameters
    ----------
    parameters, ideal
        The controller, and what its estimates are compared with.
    r
        Filtered error [um/s], shape (N,).
    estimates
        ``sigma_hat``, ``m_hat`` and ``phi_hat``, shape (N,) each.
    weight_energy
        The networks' part of V, shape (N,); see :func:`weight_energy`.
    """
    value: Array = 0.5 * ideal.mass * r**2 + weight_energy
    for name, law, true in scalar_laws(parameters, ideal):
        value += (estimates[name] - true) ** 2 / (2.0 * law.gain)
    return value


def weight_energy(
    parameters: AdaptiveNnParameters, ideal: IdealValues, weights: Array, compensator_weights: Array
) -> Array:
    """
    Return W~'Gamma^-1 W~/2, and W_c'W_c/(2 Gamma_c) where the compensator takes part; shape (N,).

    The compensator's ideal weights are taken as zero: what it could cancel stays in phi.

    Parameters
    ----------
    parameters, ideal
        The controller, and what its estimates are compared with.
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
    The bounds of theorem 4.1.

    Attributes
    ----------
    mass
        m [V s^2/um].
    error_filter
        What makes e of r.
    c1, c2
        Of (4.30) [1/s] and (4.31).
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
        """V(0) + c2/c1, which V never exceeds (4.35)."""
        return self.initial + self.c2 / self.c1

    @property
    def ultimate(self) -> float:
        """c2/c1, to which the bound on V tends (4.33)."""
        return self.c2 / self.c1

    def level(self, time: Array) -> Array:
        """Return the bound on V over time [s] (4.33)."""
        values: Array = (self.initial - self.ultimate) * np.exp(-self.c1 * time) + self.ultimate
        return values

    def r_of(self, level: float) -> float:
        """Return the largest |r| [um/s] that V <= ``level`` leaves: bound (i) of ``uniform``, (ii) of ``ultimate``."""
        return math.sqrt(2.0 * level / self.mass)

    def e_of(self, level: float) -> float:
        """
        Return the largest |e| [um] that the largest |r| leaves once the start has died away.

        It is that |r| times the L1 norm of the filter, which is 1/lambda without integral action. (4.41) adds |e(0)|,
        (4.45) is this.
        """
        return self.error_filter.norm * self.r_of(level)

    def r_over(self, time: Array) -> Array:
        """Return the bound on |r| over time (4.43) [um/s]."""
        values: Array = np.sqrt(2.0 * self.level(time) / self.mass)
        return values

    def e_over(self, time: Array, initial_error: float, initial_integral: float = 0.0) -> Array:
        """
        Return the bound on |e| over time (4.40) [um], from |r| <= (4.43) and e and its integral at the start.

        Parameters
        ----------
        time
            Equally spaced times [s].
        initial_error, initial_integral
            e(0) [um], and the integral of e at the start [um s].
        """
        return self.error_filter.error_over(time, self.r_over(time), initial_error, initial_integral)

    def omega(self, initial_error: float, initial_integral: float = 0.0) -> tuple[float, float]:
        """
        Return how far (i) lets the state be from the reference: largest |x - x_d| [um] and |v - x_d'| [um/s].

        Without integral action these are |e(0)| + R/lambda and lambda |e(0)| + 2 R, with R the bound (i) on |r|.

        Parameters
        ----------
        initial_error, initial_integral
            e(0) [um], and the integral of e at the start [um s].
        """
        own = self.error_filter
        largest_r = self.r_of(self.uniform)
        size = own.initial_size(initial_error, initial_integral)
        return size + own.norm * largest_r, own.largest_rate(size) + own.rate_norm * largest_r


def theorem_bounds(parameters: AdaptiveNnParameters, ideal: IdealValues, initial: float) -> Bounds:
    """Return the bounds for a controller, the ideal values and V(0)."""
    rate = min(convergence_rates(parameters, ideal).values())
    error_filter = ErrorFilter(parameters.error_filter_lambda, parameters.integral_gain)
    return Bounds(ideal.mass, error_filter, rate, residual_rate(parameters, ideal), initial)


def projection_allows(parameters: AdaptiveNnParameters, ideal: IdealValues) -> bool:
    """Return whether the sets of projection hold the ideal values; the compensator's, zero, are in any."""
    inside = all(law.minimum <= true <= law.maximum for _, law, true in scalar_laws(parameters, ideal))
    return inside and float(np.abs(ideal.weights).max()) <= parameters.network.maximum


@dataclasses.dataclass(frozen=True)
class Check:
    """
    A signal against its bound.

    Attributes
    ----------
    name, unit
        What was checked.
    tick, value, limit
        Where the signal comes nearest to its bound or exceeds it most, as a ratio, and both there.
    violations
        Number of ticks at which it exceeds it.
    first_violation
        Tick, value and limit of the first, None if there is none.
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
        """Limit less value; negative at a violation."""
        return self.limit - self.value

    @property
    def tightness(self) -> float:
        """Limit over value: 1 is a tight bound, 100 a loose one."""
        return self.limit / self.value if self.value > 0.0 else math.inf


def check(name: str, unit: str, values: Array, limits: Array | float, first_tick: int = 0) -> Check:
    """
    Compare a signal that is not negative with its bound, tick by tick.

    Parameters
    ----------
    name, unit
        What it is.
    values
        The signal, shape (N,).
    limits
        Its bound, one number or shape (N,).
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
    The bound on |r| while a run goes on: one exponential and one root a call.

    V(0) is known from the first r and the estimates' initial values, which are parameters; nothing else is needed.

    Parameters
    ----------
    parameters
        The controller, as it stands at the first tick.
    ideal
        From :func:`~hdd_servo_ros.stability.ideal_values.theorem_values`.
    """

    def __init__(self, parameters: AdaptiveNnParameters, ideal: IdealValues) -> None:
        self._parameters = parameters
        self._ideal = ideal
        self._start = 0.0
        self.bounds: Bounds | None = None

    def limit(self, time: float) -> float:
        """
        Return the bound on |r| [um/s] (4.43) at a time [s].

        Raises
        ------
        RuntimeError
            Before the first :meth:`margin`.
        """
        if self.bounds is None:
            raise RuntimeError('the bound is not known before the first r')
        level = (self.bounds.initial - self.bounds.ultimate) * math.exp(-self.bounds.c1 * (time - self._start))
        return self.bounds.r_of(level + self.bounds.ultimate)

    def margin(self, time: float, r: float) -> float:
        """Return the bound on |r| less |r| [um/s]; negative when it is violated. The first call sets V(0)."""
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
