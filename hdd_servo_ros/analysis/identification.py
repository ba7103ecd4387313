"""
Identification of a transfer function from a measured frequency response (thesis section 3.3).

The fit itself is in :mod:`~hdd_servo_ros.analysis.rational_fit`. This module accounts for the measurement: the weight
of each point, the hold, and aliasing.
"""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis.order_selection import MOST_POLES, best_order
from hdd_servo_ros.analysis.rational_fit import LEVY, SANATHANAN_KOERNER, identify
from hdd_servo_ros.analysis.transfer_model import Model
from hdd_servo_ros.bench.response import FrequencyResponse, held

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

SMALLEST_DEVIATION = 2e-3
"""Smallest relative deviation of a point: errors other than noise (friction, aliasing) are about as large."""
_NEIGHBORS = 9
_IMAGES = 3
_FOLDING_ROUNDS = 4
_LARGEST_ERROR = 2.0
"""Weighted rms error above which the deviations do not explain the residuals."""


def weighting_deviation(measured: FrequencyResponse, smallest: float = SMALLEST_DEVIATION) -> Array | None:
    """
    Return the standard deviation of each point for weighting; None if it was not measured.

    A deviation from a few records is uncertain, and a point whose records agree by chance would outweigh all others.
    Therefore it is the median over nine neighbors, and at least ``smallest`` times the magnitude.
    """
    relative = measured.relative_deviation()
    if relative is None:
        return None
    half = _NEIGHBORS // 2
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
    Fit a measured response, weighted by its measured variance if available, with the effects of sampling removed.

    These effects are the hold, by which the response is divided, and aliasing from above half the sampling rate, which
    is computed from the fitted model and subtracted before the next fit.

    Parameters
    ----------
    measured
        The measured response.
    poles, zeros, integrators, method
        See :func:`~hdd_servo_ros.analysis.rational_fit.identify`; if ``poles`` is None, both numbers are selected by
        :func:`~hdd_servo_ros.analysis.order_selection.select_order`.
    delay
        Computation delay of the loop, before the hold [s].

    Notes
    -----
    Source: thesis section 3.3.

    Examples
    --------
    >>> import numpy as np
    >>> from hdd_servo_ros.analysis import identify_measured
    >>> from hdd_servo_ros.bench import FrequencyResponse
    >>> frequency = np.geomspace(100.0, 3000.0, 40)
    >>> measured = FrequencyResponse.of(frequency, -4.0e7 / (2.0 * np.pi * frequency) ** 2)
    >>> f'{identify_measured(measured, poles=2, integrators=2).rigid_gain():.4g} um/s^2/V'
    '4e+07 um/s^2/V'
    """
    dynamics = held(measured.frequency, measured.hold, delay)
    response = measured.response
    deviation = weighting_deviation(measured)
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
                break  # no aliasing, or the model does not roll off or is too poor to estimate it
            folded = _aliased(model, measured, delay)
        assert best is not None
        return best

    if poles is not None:
        return fit(poles, zeros)
    return best_order(fit, measured.frequency, integrators, MOST_POLES, known_deviation=deviation is not None)


def _aliased(model: Model, measured: FrequencyResponse, delay: float) -> ComplexArray:
    """Return the aliased part of the sampled response of the model at each frequency."""
    folded: ComplexArray = np.zeros(len(measured.frequency), dtype=np.complex128)
    for image in range(-_IMAGES, _IMAGES + 1):
        if image != 0:
            frequency = measured.frequency + image / measured.hold
            # For a measured velocity divided by j 2 pi f, each image has its own frequency.
            factor = np.where(measured.by_velocity, frequency / measured.frequency, 1.0)
            folded += factor * model.response(frequency) * held(frequency, measured.hold, delay)
    return folded


def doubts(model: Model, measured: FrequencyResponse, rigid_order: int = 2) -> list[str]:
    """
    Return reasons to doubt a fitted model, one line each.

    Parameters
    ----------
    model
        Result of :func:`identify_measured`.
    measured
        The measured response.
    rigid_order
        Number of the smallest poles that belong to the rigid body; they may be below the band, where the points do not
        determine their stability.
    """
    lines = []
    gain = model.rigid_gain(rigid_order)
    if not gain > 0.0:
        lines.append(
            f'the gain of the rigid body is {gain:.6g}, expected above 0: the band or the order does not cover it, or '
            'the sign of the output is reversed'
        )
    lowest, highest = float(measured.frequency.min()), float(measured.frequency.max())
    rigid = model.poles[np.argsort(np.abs(model.poles), kind='stable')][:rigid_order]
    for mode in model.modes():
        of_rigid_body = bool(np.any(mode.pole == rigid))
        if mode.damping < 0.0 and not (of_rigid_body and mode.frequency < lowest):
            lines.append(f'the mode at {mode.frequency:.6g} Hz is unstable: its damping is {mode.damping:.3g}')
        if not lowest <= mode.frequency <= highest and not of_rigid_body:
            lines.append(
                f'the mode at {mode.frequency:.6g} Hz is outside the band of the points, {lowest:.6g} to '
                f'{highest:.6g} Hz'
            )
    if weighting_deviation(measured) is not None and model.error > _LARGEST_ERROR:
        lines.append(
            f'the weighted rms error is {model.error:.3g}: the distance of the points from the model in standard '
            'deviations from their coherence, expected about 1'
        )
    return lines
