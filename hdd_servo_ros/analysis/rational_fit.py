"""
Least-squares fit of a transfer function of given order to a frequency response (thesis eqs. 3.21 to 3.26).

Levy's least squares on the complex plane weights every point with ``|D|^2``: over a wide band the resonances and the
highest frequencies dominate. :func:`identify` has this method as printed in the thesis, and the iteration of Sanathanan
and Koerner (IEEE Transactions on Automatic Control 8, 1963), which divides by ``|D|`` of the previous iteration.

Powers of s over three decades span 10^30 at order ten. Numerator and denominator are therefore sums of polynomials that
are orthonormal on the weighted points, from the Arnoldi process (Brubeck, Nakatsukasa and Trefethen, "Vandermonde with
Arnoldi", SIAM Review 63, 2021). Their roots are eigenvalues of the Hessenberg matrix of the process with one column
changed. Frequencies are normalized by the highest one.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.transfer_model import Model

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LEVY = 'levy'
SANATHANAN_KOERNER = 'sanathanan-koerner'
METHODS = (SANATHANAN_KOERNER, LEVY)
ITERATIONS = 20
"""Largest number of iterations; about five are enough."""
_SETTLED = 1e-6
_LEAST_WEIGHED = 1e-15

__all__ = ['identify']


def identify(
    frequency: ArrayLike,
    response: ArrayLike,
    poles: int,
    zeros: int,
    *,
    integrators: int = 0,
    deviation: ArrayLike | None = None,
    method: str = SANATHANAN_KOERNER,
) -> Model:
    """
    Fit a transfer function with given numbers of poles and zeros.

    Parameters
    ----------
    frequency
        Frequencies [Hz], shape (n,).
    response
        Complex response of a continuous system, shape (n,); divide a sampled response by
        :func:`~hdd_servo_ros.bench.response.held`.
    poles, zeros
        Orders n and m (thesis eq. 3.21), with zeros <= poles; integrators count as poles.
    integrators
        Number of poles known to be at 0.
    deviation
        Standard deviation of each point, shape (n,), for the weights W_k = 1/deviation^2 (thesis eq. 3.23); by default
        the magnitude, which weights relative errors equally.
    method
        ``'levy'``: least squares (thesis eq. 3.25), once and without weights, as printed. ``'sanathanan-koerner'``:
        weighted, and iterated with ``1/|D|^2`` of the previous iteration; the result with the smallest error (thesis
        eq. 3.23) is returned.

    Raises
    ------
    ValueError
        If there are fewer points than unknowns, or an argument is out of range.

    Notes
    -----
    Source: thesis eqs. (3.21) to (3.25); Sanathanan and Koerner, IEEE Trans. Automatic Control 8(1), 1963.

    Examples
    --------
    Recover a double integrator with one mode at 4 kHz from 60 points:

    >>> import numpy as np
    >>> from hdd_servo_ros.analysis.rational_fit import identify
    >>> frequency = np.geomspace(100.0, 8000.0, 60)
    >>> s, w = 2j * np.pi * frequency, 2.0 * np.pi * 4000.0
    >>> response = 4.0e7 / s**2 * w**2 / (s**2 + 2.0 * 0.03 * w * s + w**2)
    >>> model = identify(frequency, response, poles=4, zeros=0, integrators=2)
    >>> f'{model.rigid_gain():.4g}', [f'{mode.frequency:.1f} Hz, {mode.damping:.4f}' for mode in model.modes()]
    ('4e+07', ['4000.0 Hz, 0.0300'])
    """
    f = np.asarray(frequency, dtype=np.float64)
    measured = np.asarray(response, dtype=np.complex128)
    _check(f, measured, poles, zeros, integrators, method)
    sigma = np.abs(measured) if deviation is None else np.asarray(deviation, dtype=np.float64)
    if sigma.shape != f.shape or not np.all(sigma > 0.0) or not np.all(np.isfinite(sigma)):
        raise ValueError('deviation must have one positive number per point')
    unit = 2.0 * np.pi * float(f.max())
    s: ComplexArray = np.asarray(2j * np.pi * f / unit, dtype=np.complex128)
    factor = s**integrators
    # The following uses G s^integrators, normalized by its scale.
    scale = float(np.median(np.abs(measured * factor)))
    target: ComplexArray = np.asarray(measured * factor / scale, dtype=np.complex128)
    inverse = scale / (sigma * np.abs(factor))
    start = np.ones(len(f)) if method == LEVY else inverse
    weight = start
    free = poles - integrators
    best: Model | None = None
    last = 0.0
    for _ in range(1 if method == LEVY else ITERATIONS):
        fitted, denominator, found = _linear_fit(s, target, weight, free, zeros)
        error = float(np.sqrt(np.mean(np.abs((fitted - target) * inverse) ** 2)))
        if not np.isfinite(error):
            error = np.inf
        if best is None or error < best.error:
            best = Model(
                found.zeros * unit,
                np.concatenate((np.zeros(integrators), found.poles * unit)),
                found.leading * scale * unit ** (poles - len(found.zeros)),
                error,
            )
        if np.isfinite(error) and abs(error - last) <= _SETTLED * error:
            break
        last = error
        magnitude = np.abs(denominator)
        # A denominator near zero after a poor start must not give all the weight to one point.
        weight = start / np.maximum(magnitude, _LEAST_WEIGHED * magnitude.max())
    assert best is not None
    return best


def least_points(poles: int | None, zeros: int, integrators: int = 0) -> int:
    """Return the smallest number of points for :func:`identify`, or for order selection if ``poles`` is None."""
    if poles is None:
        # Each point has two real numbers; half of them distinguish a good fit from an exact one.
        return max(integrators, 1) - integrators + 1
    return -(-(poles - integrators + zeros + 1) // 2)


def _check(f: Array, response: ComplexArray, poles: int, zeros: int, integrators: int, method: str) -> None:
    if method not in METHODS:
        raise ValueError(f'unknown method {method!r}; expected {", ".join(METHODS)}')
    if not 0 <= integrators <= poles or not 0 <= zeros <= poles:
        raise ValueError(f'{zeros} zeros or {integrators} integrators exceed the {poles} poles')
    if f.ndim != 1 or f.shape != response.shape:
        raise ValueError(f'frequency and response must have one shape, not {f.shape} and {response.shape}')
    if not (np.all(np.isfinite(f)) and np.all(np.isfinite(response)) and np.all(f > 0.0) and np.all(response != 0.0)):
        raise ValueError('frequencies must be positive, responses finite and not zero')
    if len(f) < least_points(poles, zeros, integrators):
        unknowns = poles - integrators + zeros + 1
        raise ValueError(f'{len(f)} points are too few for {unknowns} unknowns')


def _linear_fit(
    s: ComplexArray, target: ComplexArray, weight: Array, poles: int, zeros: int
) -> tuple[ComplexArray, ComplexArray, Model]:
    """Minimize sum ``|weight (N - D target)|^2`` (thesis eq. 3.25) for a fixed leading coefficient of D."""
    numerator = _orthonormal(s, weight, zeros)
    denominator = _orthonormal(s, weight * target, poles)
    columns = np.hstack((numerator.values, -denominator.values[:, :poles]))
    right = denominator.values[:, poles]
    solution = np.linalg.lstsq(
        np.vstack((columns.real, columns.imag)), np.concatenate((right.real, right.imag)), rcond=None
    )[0]
    b, a = solution[: zeros + 1], np.append(solution[zeros + 1 :], 1.0)
    n_values = numerator.values @ b / weight
    # Data without noise may give a coefficient of exactly 0, and so fewer zeros.
    significant = np.flatnonzero(np.abs(b) > np.finfo(np.float64).tiny * np.abs(b).max())
    b = b[: 1 + int(significant.max(initial=0))]
    d_values = denominator.values @ a / (weight * target)
    leading = numerator.leading(b) / denominator.leading(a)
    model = Model(numerator.roots(b), denominator.roots(a), leading, np.nan)
    with np.errstate(divide='ignore', invalid='ignore'):  # the caller handles values that are not finite
        fitted = n_values / d_values
    return fitted, d_values, model


@dataclasses.dataclass(frozen=True)
class _Basis:
    """Polynomials that are orthonormal under a weight: weighted values, recurrence, and constant."""

    values: ComplexArray
    recurrence: Array
    constant: float

    def roots(self, coefficients: Array) -> ComplexArray:
        """Return the roots of a sum of the polynomials."""
        degree = len(coefficients) - 1
        if degree == 0:
            return np.zeros(0, dtype=np.complex128)
        matrix = self.recurrence[:degree, :degree].copy()
        matrix[:, -1] -= self.recurrence[degree, degree - 1] * coefficients[:-1] / coefficients[-1]
        return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)

    def leading(self, coefficients: Array) -> float:
        """Return the coefficient of the highest power of s in a sum of the polynomials."""
        degree = len(coefficients) - 1
        steps = np.diag(self.recurrence[1 : degree + 1, :degree])
        return float(coefficients[-1] * self.constant / np.prod(steps))


def _orthonormal(s: ComplexArray, weight: ComplexArray | Array, degree: int) -> _Basis:
    """
    Return the polynomials up to ``degree`` with real coefficients, orthonormal on the points s and their conjugates.

    Parameters
    ----------
    s
        Points, shape (n,).
    weight
        Factor of each point's value, shape (n,); it may be complex.
    degree
        Degree of the last polynomial.
    """
    values = np.empty((len(s), degree + 1), dtype=np.complex128)
    recurrence = np.zeros((degree + 1, max(degree, 1)))
    constant = 1.0 / float(np.linalg.norm(weight))
    values[:, 0] = constant * weight
    for i in range(degree):
        new = s * values[:, i]
        for _ in range(2):  # repeated against rounding
            parts = (values[:, : i + 1].conj().T @ new).real
            new = new - values[:, : i + 1] @ parts
            recurrence[: i + 1, i] += parts
        recurrence[i + 1, i] = np.linalg.norm(new)
        values[:, i + 1] = new / recurrence[i + 1, i]
    return _Basis(values, recurrence, constant)
