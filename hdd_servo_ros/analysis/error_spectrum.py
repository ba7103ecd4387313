"""The cumulative spectrum of a position error, and what each source contributes to it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.metrics import power_spectral_density
from hdd_servo_ros.analysis.misregistration import standard_deviation

Array = NDArray[np.float64]

RESOLUTION = 5.0
"""Distance of the lines of a cumulative spectrum, unless another one is asked for [Hz]."""


def cumulative_spectrum(signal: ArrayLike, sample_time: float, resolution: float = RESOLUTION) -> tuple[Array, Array]:
    """
    Return frequencies [Hz] and the root of the power below each, in the signal's unit.

    By Welch's method, with half-overlapping Hann segments: the last value is sigma of the signal, but for what the
    segments do not resolve. The zero frequency is left out, since each segment's mean is.

    Parameters
    ----------
    signal
        Equally spaced samples, shape (n,), n at least 4.
    sample_time
        T [s].
    resolution
        Distance of the lines [Hz]; a record shorter than its inverse has the lines that it can have.

    Raises
    ------
    ValueError
        If there are less than four samples.
    """
    y = np.asarray(signal, dtype=np.float64)
    if len(y) < 4:
        raise ValueError(f'a spectrum needs at least 4 samples, and there are {len(y)}')
    frequencies, density = power_spectral_density(y, sample_time, segment_of(len(y), sample_time, resolution))
    return accumulated(frequencies, density)


def accumulated(frequencies: Array, density: Array) -> tuple[Array, Array]:
    """Return the frequencies of a one-sided density from its second line on, and the root of the power below each."""
    # The lines at 0 and, where there is one, at the Nyquist frequency are already those of a one-sided density.
    power = np.cumsum(density[1:]) * float(frequencies[1] - frequencies[0])
    return frequencies[1:], np.sqrt(power)


def segment_of(samples: int, sample_time: float, resolution: float) -> int:
    """Return the samples of a segment for lines that are so far apart [Hz], in a record of some samples."""
    return min(samples, max(4, round(1.0 / (resolution * sample_time))))


def error_by_source(complete: ArrayLike, without: Mapping[str, ArrayLike]) -> dict[str, float]:
    """
    Return what each source of disturbance contributes to the TMR, from runs without it.

    Sources that are independent of each other, in a linear loop, add their variances: so the contribution of one is
    3 times the root of the variance with all less the variance without it.

    Parameters
    ----------
    complete
        Position error of the run with all sources, after the transient, shape (n,).
    without
        By the source's name, the position error of the run without it, shape (m,).

    Returns
    -------
    dict
        3 sigma by source in the unit of the errors, and under ``rest`` what no source accounts for (sensor noise, for
        example). A negative value is minus the root of a negative difference: that of a source without which the error
        is larger.

    Raises
    ------
    ValueError
        If a source is named ``rest``.
    """
    return shares_by_source(
        standard_deviation(complete), {name: standard_deviation(error) for name, error in without.items()}
    )


def shares_by_source(complete: float, without: Mapping[str, float]) -> dict[str, float]:
    """Return what :func:`error_by_source` does, from the standard deviations of the errors."""
    if 'rest' in without:
        raise ValueError("a source cannot be named 'rest', which is what no source accounts for")
    variance = complete**2
    shares = {name: variance - deviation**2 for name, deviation in without.items()}
    shares['rest'] = variance - sum(shares.values())
    return {name: 3.0 * float(np.copysign(np.sqrt(abs(share)), share)) for name, share in shares.items()}
