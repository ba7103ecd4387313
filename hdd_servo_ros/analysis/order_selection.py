"""Selection of the number of poles and zeros by an information criterion over all fits."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.rational_fit import identify, least_points
from hdd_servo_ros.analysis.transfer_model import Mode, Model

Array = NDArray[np.float64]

MOST_POLES = 12
_ROUNDING = 1e-10
"""Relative error below which smaller errors do not count as a better fit."""


def select_order(
    frequency: ArrayLike,
    response: ArrayLike,
    *,
    integrators: int = 0,
    deviation: ArrayLike | None = None,
    most_poles: int = MOST_POLES,
) -> Model:
    """
    Fit every order up to ``most_poles`` and return the one with the smallest information criterion.

    The criterion is Chen and Chen's extension (Biometrika 95, 2008) of Schwarz's criterion: chi^2/v + 2 p ln 2n with
    known deviations, 2n ln chi^2 + 2 p ln 2n without them, for p unknowns and n points (2n real numbers). The second
    p ln 2n accounts for the freedom of a mode to fit noise anywhere in the band. v is 1, or the smallest chi^2/(2n - p)
    of all orders if that is larger, which means that the deviations are too small.

    A model with a doubtful mode (unstable, except for rigid-body poles below the band, or oscillating beyond the band)
    must also halve chi^2.

    Parameters
    ----------
    frequency, response, integrators, deviation
        See :func:`~hdd_servo_ros.analysis.rational_fit.identify`.
    most_poles
        Largest number of poles, integrators included.

    Raises
    ------
    ValueError
        If the points are too few for the smallest order.
    """
    f = np.asarray(frequency, dtype=np.float64)
    return best_order(
        lambda poles, zeros: identify(f, response, poles, zeros, integrators=integrators, deviation=deviation),
        f,
        integrators,
        most_poles,
        known_deviation=deviation is not None,
    )


def best_order(
    fit: Callable[[int, int], Model], frequency: Array, integrators: int, most_poles: int, *, known_deviation: bool
) -> Model:
    """Return the best model of ``fit`` over the numbers of poles and zeros; see :func:`select_order`."""
    if integrators > most_poles:
        raise ValueError(f'{integrators} integrators exceed the limit of {most_poles} poles')
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
    """Return the unstable modes in the band [Hz], and the oscillating modes beyond it."""
    return [
        mode
        for mode in model.modes()
        if (mode.damping < 0.0 and mode.frequency >= lowest) or (mode.pole.imag > 0.0 and mode.frequency > highest)
    ]
