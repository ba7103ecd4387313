"""What a parameter takes in a campaign: a list of values, a range, or draws of a distribution by a plan."""

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
"""Significant digits of drawn numbers: those that do not depend on a library's last bit."""
_LEAST = 2.0**-53
"""Distance of the draws of [0, 1] from its ends, where a normal distribution is infinite."""


@dataclasses.dataclass(frozen=True)
class Distribution:
    """
    A distribution of a number.

    Attributes
    ----------
    kind
        ``uniform`` between two numbers, ``normal`` with mean and standard deviation, or ``log_uniform``: the logarithm
        is uniform between those of two numbers above 0.
    first, second
        The two numbers.
    """

    kind: str
    first: float
    second: float

    def __post_init__(self) -> None:
        numbers = f'{self.kind}: [{self.first:g}, {self.second:g}]'
        if self.kind not in DISTRIBUTIONS:
            raise ArgumentError(f'distribution {self.kind!r} is none of {", ".join(DISTRIBUTIONS)}')
        if not np.isfinite([self.first, self.second]).all():
            raise ArgumentError(f'{numbers} is not allowed: both numbers must be finite')
        if self.kind == 'normal':
            if self.second <= 0.0:
                raise ArgumentError(f'{numbers} is not allowed: the standard deviation must be above 0')
        elif self.first >= self.second:
            raise ArgumentError(f'{numbers} is not allowed: the first number must be below the second')
        elif self.kind == 'log_uniform' and self.first <= 0.0:
            raise ArgumentError(f'{numbers} is not allowed: both numbers must be above 0')

    def at(self, shares: NDArray[np.float64]) -> list[float]:
        """
        Return the numbers that a share of the distribution does not exceed, its quantiles, to 12 digits.

        Parameters
        ----------
        shares
            In [0, 1], shape (n,).
        """
        inside = np.clip(shares, _LEAST, 1.0 - _LEAST)
        if self.kind == 'uniform':
            found = self.first + (self.second - self.first) * inside
        elif self.kind == 'normal':
            # Late: importing scipy takes longer than a short campaign's set-up.
            from scipy.special import ndtri

            found = self.first + self.second * ndtri(inside)
        else:
            low, high = elementary.log(self.first), elementary.log(self.second)
            found = np.array([elementary.exp(low + (high - low) * share) for share in inside.tolist()])
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
        ``random``, each point by itself; ``latin_hypercube``, in each dimension one point per interval of 1 / runs; or
        ``sobol``, a scrambled Sobol sequence, best with a power of two of runs.
    seed
        Of the points.
    runs, dimensions
        How many.
    """
    random = np.random.default_rng(seed)
    if plan == 'random':
        return random.random((runs, dimensions))
    from scipy.stats import qmc

    make: Callable[..., Any] = {'latin_hypercube': qmc.LatinHypercube, 'sobol': qmc.Sobol}[plan]
    # The argument had another name before scipy 1.15.
    keyword = 'rng' if 'rng' in inspect.signature(make).parameters else 'seed'
    engine = make(dimensions, **{keyword: random})
    if plan == 'sobol':
        # More than are needed, since scipy warns of other counts than powers of two.
        return np.asarray(engine.random_base2(max(runs - 1, 1).bit_length())[:runs])
    return np.asarray(engine.random(runs))


def values_of_range(kind: str, numbers: Sequence[Any], where: str) -> list[float]:
    """
    Return the numbers of a range: first, last and how many.

    Parameters
    ----------
    kind
        ``linspace``, equal steps, or ``logspace``, equal ratios.
    numbers
        First, last, count; first and last are in the range.
    where
        What is named in an error.
    """
    if len(numbers) != 3 or type(numbers[2]) is not int or numbers[2] < 2:
        raise ArgumentError(f'{where}: {kind}: {list(numbers)} is not [first, last, count] with a count of at least 2')
    first, last, count = float(numbers[0]), float(numbers[1]), numbers[2]
    steps = [index / (count - 1) for index in range(1, count - 1)]
    if kind == 'linspace':
        found = [(1.0 - step) * first + step * last for step in steps]
    else:
        if first <= 0.0 or last <= 0.0:
            raise ArgumentError(f'{where}: logspace: {list(numbers)} is not allowed: first and last must be above 0')
        low, high = elementary.log(first), elementary.log(last)
        found = [elementary.exp(low + (high - low) * step) for step in steps]
    return [first, *map(rounded, found), last]


def scaled(base: object, factor: float, where: str) -> object:
    """Return a number, or each of a list, times a factor; raises :class:`ArgumentError` for anything else."""
    if isinstance(base, tuple | list):
        return tuple(scaled(element, factor, where) for element in base)
    if isinstance(base, bool) or not isinstance(base, int | float):
        raise ArgumentError(f'{where}: times_base is not allowed: its base value {base!r} is not a number')
    return rounded(base * factor)


def only_keys(mapping: Mapping[str, object], allowed: Sequence[str], where: str) -> None:
    """Reject keys that are not allowed; raises :class:`ArgumentError`."""
    for key in mapping:
        if key not in allowed:
            raise ArgumentError(f'{where}: no such entry {key!r}; there are {", ".join(allowed)}')
