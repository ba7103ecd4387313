"""
Identification of section 3.3: a transfer function from a measured frequency response.

The fit itself is :mod:`~hdd_servo_ros.analysis.rational_fit`. Here it gets what is known of the measurement: the
weight of each point, the hold, and what sampling folds back.
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
"""Relative deviation below which a point is not believed: what is not noise (friction, folding) is about as large."""
_NEIGHBORS = 9
_IMAGES = 3
_FOLDING_ROUNDS = 4
_LARGEST_ERROR = 2.0
"""Weighted rms error above which the deviations cannot be those of the points about the model."""


def believed_deviation(measured: FrequencyResponse, smallest: float = SMALLEST_DEVIATION) -> Array | None:
    """
    Return the standard deviation of each point for the weight, None if none was measured.

    A deviation from a few records is itself uncertain, and a point whose records agree by chance would outweigh all
    others: so it is the median over nine neighbors, and at least ``smallest`` times the magnitude.
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
    Fit a measured response, weighted by its measured variance if it has one, with what sampling did to it taken out.

    That is the hold, which divides, and what is folded back from beyond half the sampling rate: the fitted model says
    how much that is, it is subtracted, and the rest fitted again.

    Parameters
    ----------
    measured
        The measurement.
    poles, zeros, integrators, method
        See :func:`~hdd_servo_ros.analysis.rational_fit.identify`; with None for the poles both numbers are selected by
        :func:`~hdd_servo_ros.analysis.order_selection.select_order`.
    delay
        Of the loop's computation, before the hold [s].

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
    return best_order(fit, measured.frequency, integrators, MOST_POLES, known_deviation=deviation is not None)


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
