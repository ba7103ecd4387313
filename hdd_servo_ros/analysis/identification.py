"""
Identification of section 3.3: a transfer function from a measured frequency response, (3.21) to (3.26).

    python -m hdd_servo_ros.analysis.identification FILE.csv [--poles 10 --zeros 4]

Levy's least squares on the complex plane weighs every point with |D|^2, which over a wide band means by the resonances
and the highest frequencies alone. :func:`identify` offers it as it stands in the thesis, and the iteration of
Sanathanan and Koerner (IEEE Transactions on Automatic Control 8, 1963), which divides by the |D| of the round before.

Powers of s over three decades span 10^30 at order ten, so neither polynomial is ever written in them: numerator and
denominator are sums of polynomials that are orthonormal on the weighted points, made by the Arnoldi process (Brubeck,
Nakatsukasa and Trefethen, "Vandermonde with Arnoldi", SIAM Review 63, 2021). Their roots are eigenvalues of the
process's Hessenberg matrix with one column changed. The frequency is normalised by the highest one.
"""

import argparse
import dataclasses
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.bench.response import FrequencyResponse, held, read_csv

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LEVY = 'levy'
SANATHANAN_KOERNER = 'sanathanan-koerner'
METHODS = (SANATHANAN_KOERNER, LEVY)
ITERATIONS = 20
"""Rounds of the iteration at most; it settles in about five."""
_SETTLED = 1e-6
_LEAST_WEIGHED = 1e-15
_ROUNDING = 1e-10
"""Relative error below which a smaller one is no better fit."""
SMALLEST_DEVIATION = 2e-3
"""Relative deviation below which a point is not believed: what is not noise (friction, folding) is about as large."""
_NEIGHBOURS = 9
_IMAGES = 3
_FOLDING_ROUNDS = 4
MOST_POLES = 12
_LARGEST_ERROR = 2.0
"""Weighted rms error above which the deviations cannot be those of the points about the model."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """
    A pole with its part r/(s - p) of the response; a complex one stands for its pair.

    Attributes
    ----------
    pole
        p [rad/s].
    residue
        r, in the response's unit times rad/s.
    """

    pole: complex
    residue: complex

    @property
    def frequency(self) -> float:
        """Natural frequency |p|/(2 pi) [Hz]."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio -Re p/|p|; 1 of a real stable pole, 0 of an integrator, negative of an unstable pole."""
        return -self.pole.real / abs(self.pole) if self.pole else 0.0


@dataclasses.dataclass(frozen=True)
class Model:
    """
    A transfer function by its zeros, poles and leading gain, as ``scipy.signal.ZerosPolesGain`` takes them.

    Attributes
    ----------
    zeros, poles
        [rad/s], complex, shapes (m,) and (n,); integrators are poles at 0 and come first.
    leading
        b_m/a_n of (3.21).
    error
        Root mean square over the points of |fit - data|/deviation: 0.01 is 1 % when the deviation is the magnitude.
    """

    zeros: ComplexArray
    poles: ComplexArray
    leading: float
    error: float

    def response(self, frequency: ArrayLike) -> ComplexArray:
        """Return the response at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        value = np.full(s.shape, complex(self.leading))
        # By turns, so that no intermediate product leaves the range of a float64.
        for i, pole in enumerate(self.poles):
            value = value / (s - pole)
            if i < len(self.zeros):
                value = value * (s - self.zeros[i])
        return value

    def rigid_gain(self, order: int = 2) -> float:
        """
        Return K of K/s^2 R(s) with R(0) = 1: the gain of the rigid body.

        Parameters
        ----------
        order
            How many poles of least magnitude are the rigid body's: 2 for a double integrator, held by a spring or not;
            0 gives the static gain.
        """
        modes = self.poles[np.argsort(np.abs(self.poles), kind='stable')][order:]
        return float((self.leading * np.prod(-self.zeros) / np.prod(-modes)).real)

    def modes(self) -> list[Mode]:
        """Return the poles of the upper half plane and the real ones, by frequency; integrators are left out."""
        found = []
        for i, pole in enumerate(self.poles):
            if pole == 0.0 or pole.imag < 0.0:
                continue
            residue = self.leading * np.prod(pole - self.zeros) / np.prod(pole - np.delete(self.poles, i))
            found.append(Mode(complex(pole), complex(residue)))
        return sorted(found, key=lambda mode: mode.frequency)


@dataclasses.dataclass(frozen=True)
class _Basis:
    """Polynomials that are orthonormal under a weight: their weighted values, their recurrence, and the constant."""

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
        Of the last polynomial.
    """
    values = np.empty((len(s), degree + 1), dtype=np.complex128)
    recurrence = np.zeros((degree + 1, max(degree, 1)))
    constant = 1.0 / float(np.linalg.norm(weight))
    values[:, 0] = constant * weight
    for i in range(degree):
        new = s * values[:, i]
        for _ in range(2):  # once more, against the rounding of the first time
            parts = (values[:, : i + 1].conj().T @ new).real
            new = new - values[:, : i + 1] @ parts
            recurrence[: i + 1, i] += parts
        recurrence[i + 1, i] = np.linalg.norm(new)
        values[:, i + 1] = new / recurrence[i + 1, i]
    return _Basis(values, recurrence, constant)


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
    Fit a transfer function with so many poles and zeros.

    Parameters
    ----------
    frequency
        [Hz], shape (n,).
    response
        Complex, shape (n,), of a continuous system: divide a sampled one by :func:`~hdd_servo_ros.bench.response.held`.
    poles, zeros
        n and m of (3.21), with zeros <= poles; integrators count among the poles.
    integrators
        How many of the poles are known to be at 0.
    deviation
        Standard deviation of each point, shape (n,), whose inverse is the weight of W_k = 1/deviation^2 in (3.23); by
        default the magnitude, so that every point counts by its relative error.
    method
        ``'levy'``: the least squares (3.25), once, without any weight, as printed. ``'sanathanan-koerner'``: weighted,
        and iterated with 1/|D|^2 of the round before; the round with the least error (3.23) is returned.

    Raises
    ------
    ValueError
        If there are fewer points than unknowns, or an argument is out of range.
    """
    f = np.asarray(frequency, dtype=np.float64)
    measured = np.asarray(response, dtype=np.complex128)
    _check(f, measured, poles, zeros, integrators, method)
    sigma = np.abs(measured) if deviation is None else np.asarray(deviation, dtype=np.float64)
    if sigma.shape != f.shape or not np.all(sigma > 0.0) or not np.all(np.isfinite(sigma)):
        raise ValueError('deviation must hold one positive number a point')
    unit = 2.0 * np.pi * float(f.max())
    s: ComplexArray = np.asarray(2j * np.pi * f / unit, dtype=np.complex128)
    factor = s**integrators
    # Everything below is about G s^integrators, whose scale is taken out as well.
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
        # A denominator that a poor start leaves at nothing somewhere must not make that point the only one.
        weight = start / np.maximum(magnitude, _LEAST_WEIGHED * magnitude.max())
    assert best is not None
    return best


def _check(f: Array, response: ComplexArray, poles: int, zeros: int, integrators: int, method: str) -> None:
    if method not in METHODS:
        raise ValueError(f'method is {method!r}; there are {", ".join(METHODS)}')
    if not 0 <= integrators <= poles or not 0 <= zeros <= poles:
        raise ValueError(f'{poles} poles, {zeros} zeros, {integrators} integrators: neither may exceed the poles')
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
    """Minimise sum |weight (N - D target)|^2, (3.25), with the leading coefficient of D fixed; return N/D, D, model."""
    numerator = _orthonormal(s, weight, zeros)
    denominator = _orthonormal(s, weight * target, poles)
    columns = np.hstack((numerator.values, -denominator.values[:, :poles]))
    right = denominator.values[:, poles]
    solution = np.linalg.lstsq(
        np.vstack((columns.real, columns.imag)), np.concatenate((right.real, right.imag)), rcond=None
    )[0]
    b, a = solution[: zeros + 1], np.append(solution[zeros + 1 :], 1.0)
    n_values = numerator.values @ b / weight
    # Data without noise may leave a coefficient at exactly nothing: there are as many zeros fewer.
    significant = np.flatnonzero(np.abs(b) > np.finfo(np.float64).tiny * np.abs(b).max())
    b = b[: 1 + int(significant.max(initial=0))]
    d_values = denominator.values @ a / (weight * target)
    leading = numerator.leading(b) / denominator.leading(a)
    model = Model(numerator.roots(b), denominator.roots(a), leading, np.nan)
    with np.errstate(divide='ignore', invalid='ignore'):  # the caller sees to what is not finite
        fitted = n_values / d_values
    return fitted, d_values, model


def select_order(
    frequency: ArrayLike,
    response: ArrayLike,
    *,
    integrators: int = 0,
    deviation: ArrayLike | None = None,
    most_poles: int = MOST_POLES,
) -> Model:
    """
    Fit every order up to ``most_poles`` and return the one whose residual earns its unknowns.

    That is the least of Chen and Chen's extension (Biometrika 95, 2008) of Schwarz's criterion: with known deviations
    chi^2/v + 2 p ln 2n, without them 2n ln chi^2 + 2 p ln 2n, for p unknowns and n points (2n real numbers). The second
    p ln 2n is for the choice that a mode has: it settles wherever in the band the noise looks most like one. v is 1, or
    the least chi^2/(2n - p) of all orders where that is more: the deviations are then too small.

    A model with a doubtful mode (unstable, unless below the band as the rigid body's poles may come out; or oscillating
    beyond the band) must besides halve chi^2.

    Parameters
    ----------
    frequency, response, integrators, deviation
        As of :func:`identify`.
    most_poles
        Largest number of poles, integrators included.

    Raises
    ------
    ValueError
        If the points are too few for the smallest order.
    """
    f = np.asarray(frequency, dtype=np.float64)
    return _selected(
        lambda poles, zeros: identify(f, response, poles, zeros, integrators=integrators, deviation=deviation),
        f,
        integrators,
        most_poles,
        known_deviation=deviation is not None,
    )


def least_points(poles: int | None, zeros: int, integrators: int = 0) -> int:
    """Return how many points :func:`identify` takes at least, or with None for the poles :func:`select_order`."""
    if poles is None:
        # Of two real numbers a point, half are to tell a good fit from an exact one.
        return max(integrators, 1) - integrators + 1
    return -(-(poles - integrators + zeros + 1) // 2)


def _selected(
    fit: Callable[[int, int], Model], frequency: Array, integrators: int, most_poles: int, *, known_deviation: bool
) -> Model:
    """Return the best of the models that ``fit`` makes for numbers of poles and zeros; see :func:`select_order`."""
    if integrators > most_poles:
        raise ValueError(f'{integrators} integrators are more than the {most_poles} poles there may be')
    fewest = max(integrators, 1)
    if len(frequency) < least_points(None, 0, integrators):
        raise ValueError(f'{len(frequency)} points are too few to select an order')
    numbers = 2 * len(frequency)
    models = [
        fit(poles, zeros)
        for poles in range(fewest, most_poles + 1)
        for zeros in range(poles + 1)
        if numbers >= 2 * (poles - integrators + zeros + 1)
    ]
    unknowns = np.array([len(model.poles) - integrators + len(model.zeros) + 1 for model in models])
    chi_squared = numbers * np.array([model.error for model in models]) ** 2
    if known_deviation:
        misfit = chi_squared / max(1.0, float(np.min(chi_squared / (numbers - unknowns))))
    else:
        misfit = numbers * np.log(np.maximum(chi_squared, numbers * _ROUNDING**2))
    doubtful = np.array([bool(_doubtful(model, frequency.min(), frequency.max())) for model in models])
    criterion = misfit + 2.0 * unknowns * np.log(numbers) + doubtful * numbers * np.log(2.0)
    return models[int(np.argmin(criterion))]


def _doubtful(model: Model, lowest: float, highest: float) -> list[Mode]:
    """Return the modes of the band [Hz] that are unstable, and those beyond it that oscillate."""
    return [
        mode
        for mode in model.modes()
        if (mode.damping < 0.0 and mode.frequency >= lowest) or (mode.pole.imag > 0.0 and mode.frequency > highest)
    ]


def believed_deviation(measured: FrequencyResponse, smallest: float = SMALLEST_DEVIATION) -> Array | None:
    """
    Return the standard deviation of each point for the weight, None if none was measured.

    A deviation from a few records is itself uncertain, and a point whose records agree by chance would outweigh all
    others: so it is the median over nine neighbours, and at least ``smallest`` times the magnitude.
    """
    relative = measured.relative_deviation()
    if relative is None:
        return None
    half = _NEIGHBOURS // 2
    windows = [relative[max(i - half, 0) : i + half + 1] for i in range(len(relative))]
    smooth = np.array([np.median(window) for window in windows])
    return np.asarray(np.maximum(smooth, smallest) * np.abs(measured.response))


def identify_measured(
    measured: FrequencyResponse,
    poles: int | None = None,
    zeros: int = 0,
    *,
    integrators: int = 0,
    delay: float = 0.0,
    method: str = SANATHANAN_KOERNER,
) -> Model:
    """
    Fit a measured response, weighted by its measured variance if it has one, with what sampling did to it taken out.

    That is the hold, which divides, and what is folded back from beyond half the sampling rate: the fitted model says
    how much that is, it is subtracted, and the rest fitted again.

    Parameters
    ----------
    measured
        The measurement.
    poles, zeros, integrators, method
        As of :func:`identify`; None for the poles lets both numbers be chosen as by :func:`select_order`.
    delay
        Of the loop's computation, before the hold [s].
    """
    dynamics = held(measured.frequency, measured.hold, delay)
    response = measured.response
    deviation = believed_deviation(measured)
    if deviation is not None:
        deviation = deviation / np.abs(dynamics)

    def fit(poles: int, zeros: int) -> Model:
        best: Model | None = None
        folded: ComplexArray = np.zeros(len(response), dtype=np.complex128)
        for _ in range(1 + _FOLDING_ROUNDS):
            model = identify(
                measured.frequency,
                (measured.response - folded) / dynamics,
                poles,
                zeros,
                integrators=integrators,
                deviation=deviation,
                method=method,
            )
            if best is not None and model.error >= best.error:
                break
            best = model
            if measured.hold == 0.0 or zeros > poles - 2 or method == LEVY:
                break  # nothing is folded, or the model does not fall off or is too poor to say how
            folded = _folded_back(model, measured, delay)
        assert best is not None
        return best

    if poles is not None:
        return fit(poles, zeros)
    return _selected(fit, measured.frequency, integrators, MOST_POLES, known_deviation=deviation is not None)


def _folded_back(model: Model, measured: FrequencyResponse, delay: float) -> ComplexArray:
    """Return what a sampled response of the model has from the images of each frequency about the sampling rate."""
    folded: ComplexArray = np.zeros(len(measured.frequency), dtype=np.complex128)
    for image in range(-_IMAGES, _IMAGES + 1):
        if image != 0:
            frequency = measured.frequency + image / measured.hold
            # A velocity that was read and divided by j 2 pi f has each image's own frequency in it.
            factor = np.where(measured.by_velocity, frequency / measured.frequency, 1.0)
            folded += factor * model.response(frequency) * held(frequency, measured.hold, delay)
    return folded


def doubts(model: Model, measured: FrequencyResponse, rigid_order: int = 2) -> list[str]:
    """
    Return what makes a fitted model doubtful, a line each.

    Parameters
    ----------
    model
        From :func:`identify_measured`.
    measured
        What it was fitted to.
    rigid_order
        How many poles of least magnitude are the rigid body's: those may lie below the band, where no point says
        whether they are stable.
    """
    lines = []
    gain = model.rigid_gain(rigid_order)
    if not gain > 0.0:
        lines.append(
            f'the gain of the rigid body is {gain:.6g}, not above 0: the band or the order does not show it, or the '
            "output's sign is reversed"
        )
    lowest, highest = float(measured.frequency.min()), float(measured.frequency.max())
    rigid = model.poles[np.argsort(np.abs(model.poles), kind='stable')][:rigid_order]
    for mode in model.modes():
        of_rigid_body = bool(np.any(mode.pole == rigid))
        if mode.damping < 0.0 and not (of_rigid_body and mode.frequency < lowest):
            lines.append(f'the mode at {mode.frequency:.6g} Hz is unstable: its damping is {mode.damping:.3g}')
        if not lowest <= mode.frequency <= highest and not of_rigid_body:
            lines.append(
                f'the mode at {mode.frequency:.6g} Hz lies outside the band of the points, {lowest:.6g} to '
                f'{highest:.6g} Hz'
            )
    if believed_deviation(measured) is not None and model.error > _LARGEST_ERROR:
        lines.append(
            f'the weighted rms error is {model.error:.3g}: the model misses the points by that many of the standard '
            'deviations that their coherence says, which should be about 1'
        )
    return lines


def table(model: Model, rigid_order: int = 2, unit: str = '') -> str:
    """
    Return gain and modes in words.

    Parameters
    ----------
    model
        The model.
    rigid_order
        As of :meth:`Model.rigid_gain`.
    unit
        Of the response; empty where it is not known.
    """
    unit = unit or 'magnitude'
    residue_unit = f'{unit} rad/s'
    width = max(12, len(residue_unit) + 12)
    lines = [
        f'{len(model.poles)} poles, {len(model.zeros)} zeros; weighted rms error {model.error:.3g}',
        f'gain of the rigid body {model.rigid_gain(rigid_order):.6g} {_per_second(unit, rigid_order)} '
        f'(poles of least magnitude: {rigid_order})',
        f'{"frequency [Hz]":>16} {"damping":>10} {f"|residue| [{residue_unit}]":>{width}} {"phase [deg]":>12}',
    ]
    lines += [
        f'{mode.frequency:16.2f} {mode.damping:10.5f} {abs(mode.residue):{width}.5g} '
        f'{np.degrees(np.angle(mode.residue)):12.1f}'
        for mode in model.modes()
    ]
    return '\n'.join(lines)


def _per_second(unit: str, order: int) -> str:
    """Return a unit divided by s to the power of ``order``."""
    if order == 0:
        return unit
    above, slash, below = unit.partition('/')
    return f'{above}/({below} s^{order})' if slash else f'{unit}/s^{order}'


def _count(text: str) -> int:
    """Return a number of zeros or integrators; argparse tells what is none."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f'{number} is negative')
    return number


def _positive_count(text: str) -> int:
    """Return a number of poles; argparse tells what is none."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f'{number} is not above 0')
    return number


def _time(text: str) -> float:
    """Return a time [s]; argparse tells what is none."""
    number = float(text)
    if not 0.0 <= number < np.inf:
        raise argparse.ArgumentTypeError(f'{text} is no time: it must be finite and not negative [s]')
    return number


def _frequency(text: str) -> float:
    """Return a limit of the band [Hz]; argparse tells what is none."""
    number = float(text)
    if not number >= 0.0:
        raise argparse.ArgumentTypeError(f'{text} is no frequency: it must not be negative [Hz]')
    return number


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify the response of a CSV file and print gain and modes; returns 2 for bad arguments or a bad file."""
    parser = argparse.ArgumentParser(
        prog='python -m hdd_servo_ros.analysis.identification',
        description='Fit a transfer function to a CSV of frequency, magnitude and phase (section 3.3).',
    )
    parser.add_argument('file', type=Path, help='columns named with units, as of signal_analyzer; or Hz, linear, deg')
    parser.add_argument('--poles', type=_positive_count, help='number of poles; without it the residual selects')
    parser.add_argument('--zeros', type=_count, help='number of zeros, with --poles (default: 0)')
    parser.add_argument('--integrators', type=_count, default=0, help='how many of the poles are known to be at 0')
    parser.add_argument(
        '--rigid-order', type=int, choices=(2, 0), default=2, help='poles of the rigid body: 2, or 0 for a static gain'
    )
    parser.add_argument(
        '--from', type=_frequency, default=0.0, dest='lowest', metavar='HZ', help='lowest frequency used'
    )
    parser.add_argument(
        '--to', type=_frequency, default=np.inf, dest='highest', metavar='HZ', help='highest frequency used'
    )
    parser.add_argument('--hold', type=_time, help="hold in the response [s], instead of the file's; 0 for none")
    parser.add_argument('--delay', type=_time, default=0.0, help='computation delay in the response [s]')
    parser.add_argument('--method', choices=METHODS, default=SANATHANAN_KOERNER)
    given = parser.parse_args(arguments)
    if given.method == LEVY and given.poles is None:
        parser.error('--method levy wants --poles: the order is selected among iterated fits')
    if given.zeros is not None and given.poles is None:
        parser.error('--zeros wants --poles: without it the residual selects both numbers')
    if given.integrators > given.rigid_order:
        parser.error(f'--integrators {given.integrators} is more than --rigid-order, which is {given.rigid_order}')
    if given.lowest > given.highest:
        parser.error(f'--from {given.lowest:g} lies above --to {given.highest:g}')
    zeros = given.zeros or 0
    try:
        measured = _used(given, zeros)
        model = identify_measured(
            measured,
            given.poles,
            zeros,
            integrators=given.integrators,
            delay=given.delay,
            method=given.method,
        )
    except (OSError, ValueError) as error:
        print(f'identification: {error}', file=sys.stderr)
        return 2
    for line in doubts(model, measured, given.rigid_order):
        print(f'identification: warning: {line}', file=sys.stderr)
    try:
        print(table(model, given.rigid_order, measured.unit), flush=True)
    except BrokenPipeError:
        # The reader has seen enough. What Python still has to write at its end goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _used(given: argparse.Namespace, zeros: int) -> FrequencyResponse:
    """Return the points of the file that the options leave; raises ValueError if those are too few."""
    whole = read_csv(given.file)
    measured = whole.between(given.lowest, given.highest)
    least = least_points(given.poles, zeros, given.integrators)
    if len(measured.frequency) < least:
        wanted = 'to select an order' if given.poles is None else f'for {given.poles} poles and {zeros} zeros'
        limits = {f'--from {given.lowest:g}': given.lowest > 0.0, f'--to {given.highest:g}': given.highest < np.inf}
        said = ' '.join(option for option, is_given in limits.items() if is_given)
        raise ValueError(
            f'{given.file}: {said}{" leaves " * bool(said)}{len(measured.frequency)} of {len(whole.frequency)} points '
            f'from {whole.frequency[0]:.6g} to {whole.frequency[-1]:.6g} Hz, and it takes at least {least} {wanted}'
        )
    return measured if given.hold is None else dataclasses.replace(measured, hold=given.hold)


if __name__ == '__main__':
    sys.exit(main())
