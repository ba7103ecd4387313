"""Values of a varied parameter: a list, a range, or samples of a distribution."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.numerics import elementary
from hdd_servo_ros.parameters.files import ArgumentError

PLANS = ('random', 'latin_hypercube', 'sobol')
DISTRIBUTIONS = ('uniform', 'normal', 'log_uniform')
RANGES = ('linspace', 'logspace')
_DIGITS = 12
"""Significant digits of sampled values: few enough not to depend on the last bit of a library."""
_LEAST = 2.0**-53
"""Smallest distance of a sample of [0, 1] from the ends, where a normal quantile is infinite."""


@dataclasses.dataclass(frozen=True)
class Distribution:
    """
    A distribution of a parameter value.

    Attributes
    ----------
    kind
        ``uniform`` between two numbers, ``normal`` with mean and standard deviation, or ``log_uniform`` between two
        positive numbers (the logarithm is uniform).
    first, second
        The two numbers.
    """

    kind: str
    first: float
    second: float

    def __post_init__(self) -> None:
        numbers = f'{self.kind}: [{self.first:g}, {self.second:g}]'
        if self.kind not in DISTRIBUTIONS:
            raise ArgumentError(f'unknown distribution {self.kind!r}; expected one of {", ".join(DISTRIBUTIONS)}')
        if not np.isfinite([self.first, self.second]).all():
            raise ArgumentError(f'{numbers} is invalid; expected finite numbers')
        if self.kind == 'normal':
            if self.second <= 0.0:
                raise ArgumentError(f'{numbers} is invalid; expected a standard deviation above 0')
        elif self.first >= self.second:
            raise ArgumentError(f'{numbers} is invalid; expected the first number below the second')
        elif self.kind == 'log_uniform' and self.first <= 0.0:
            raise ArgumentError(f'{numbers} is invalid; expected numbers above 0')

    def at(self, fractions: NDArray[np.float64]) -> list[float]:
        """
        Return quantiles of the distribution, to 12 significant digits.

        Parameters
        ----------
        fractions
            Probabilities in [0, 1], shape (n,).
        """
        inside = np.clip(fractions, _LEAST, 1.0 - _LEAST)
        if self.kind == 'uniform':
            found = self.first + (self.second - self.first) * inside
        elif self.kind == 'normal':
            # Imported late: importing scipy takes longer than the setup of a short campaign.
            from scipy.special import ndtri

            found = self.first + self.second * ndtri(inside)
        else:
            low, high = elementary.log(self.first), elementary.log(self.second)
            found = np.array([elementary.exp(low + (high - low) * fraction) for fraction in inside.tolist()])
        return [rounded(number) for number in found.tolist()]


def rounded(number: float) -> float:
    """Return a number to 12 significant digits."""
    return float(f'{number:.{_DIGITS}g}')


def shares(plan: str, seed: int, runs: int, dimensions: int) -> NDArray[np.float64]:
    """
    Return points of the unit cube, shape (runs, dimensions).

    Parameters
    ----------
    plan
        ``random``: independent points; ``latin_hypercube``: one point per interval of 1 / runs in each dimension;
        ``sobol``: a scrambled Sobol sequence, best with a power of two as the number of runs.
    seed
        Seed of the points.
    runs, dimensions
        Number of points, and of coordinates per point.
    """
    random = np.random.default_rng(seed)
    if plan == 'random':
        return random.random((runs, dimensions))
    from scipy.stats import qmc

    make: Callable[..., Any] = {'latin_hypercube': qmc.LatinHypercube, 'sobol': qmc.Sobol}[plan]
    # Renamed in scipy 1.15.
    keyword = 'rng' if 'rng' in inspect.signature(make).parameters else 'seed'
    engine = make(dimensions, **{keyword: random})
    if plan == 'sobol':
        # More points than needed: scipy warns of counts that are not powers of two.
        return np.asarray(engine.random_base2(max(runs - 1, 1).bit_length())[:runs])
    return np.asarray(engine.random(runs))


def values_of_range(kind: str, numbers: Sequence[Any], where: str) -> list[float]:
    """
    Return the values of a range from first, last and count.

    Parameters
    ----------
    kind
        ``linspace`` (equal steps) or ``logspace`` (equal ratios).
    numbers
        First, last, count; the range includes first and last.
    where
        Entry to name in an error.
    """
    if len(numbers) != 3 or type(numbers[2]) is not int or numbers[2] < 2:
        raise ArgumentError(
            f'{where}: {kind}: {list(numbers)} is invalid; expected [first, last, count] with a count of at least 2'
        )
    first, last, count = float(numbers[0]), float(numbers[1]), numbers[2]
    steps = [index / (count - 1) for index in range(1, count - 1)]
    if kind == 'linspace':
        found = [(1.0 - step) * first + step * last for step in steps]
    else:
        if first <= 0.0 or last <= 0.0:
            raise ArgumentError(f'{where}: logspace: {list(numbers)} is invalid; expected first and last above 0')
        low, high = elementary.log(first), elementary.log(last)
        found = [elementary.exp(low + (high - low) * step) for step in steps]
    return [first, *map(rounded, found), last]


def scaled(base: object, factor: float, where: str) -> object:
    """Return a number, or each element of a list, times a factor; raises :class:`ArgumentError` otherwise."""
    if isinstance(base, tuple | list):
        return tuple(scaled(element, factor, where) for element in base)
    if isinstance(base, bool) or not isinstance(base, int | float):
        raise ArgumentError(f'{where}: times_base is invalid: the base value {base!r} is not a number')
    return rounded(base * factor)


def only_keys(mapping: Mapping[str, object], allowed: Sequence[str], where: str) -> None:
    """Reject unknown keys; raises :class:`ArgumentError`."""
    for key in mapping:
        if key not in allowed:
            raise ArgumentError(f'{where}: unknown entry {key!r}; expected {", ".join(allowed)}')
