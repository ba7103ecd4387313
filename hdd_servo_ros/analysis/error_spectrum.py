"""Cumulative spectrum of a position error, and the contribution of each disturbance source."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.analysis.metrics import power_spectral_density
from hdd_servo_ros.analysis.misregistration import standard_deviation

Array = NDArray[np.float64]

RESOLUTION = 5.0
"""Default resolution of a cumulative spectrum [Hz]."""


def cumulative_spectrum(signal: ArrayLike, sample_time: float, resolution: float = RESOLUTION) -> tuple[Array, Array]:
    """
    Return frequencies [Hz] and the root of the power below each of them, in the unit of the signal.

    The method is Welch's, with half-overlapping Hann segments. The last value is sigma of the signal, apart from
    frequencies that the segments do not resolve. The zero frequency is omitted, like the mean of each segment.

    Parameters
    ----------
    signal
        Equally spaced samples, shape (n,), n at least 4.
    sample_time
        Sample time T [s].
    resolution
        Distance of the lines [Hz]; a record shorter than its inverse has a coarser resolution.

    Raises
    ------
    ValueError
        If the signal has fewer than four samples.
    """
    y = np.asarray(signal, dtype=np.float64)
    if len(y) < 4:
        raise ValueError(f'a spectrum needs at least 4 samples; the signal has {len(y)}')
    frequencies, density = power_spectral_density(y, sample_time, segment_of(len(y), sample_time, resolution))
    return accumulated(frequencies, density)


def accumulated(frequencies: Array, density: Array) -> tuple[Array, Array]:
    """Return the frequencies of a one-sided density without the first, and the root of the power below each."""
    # The lines at 0 and at the Nyquist frequency, if it exists, are already those of a one-sided density.
    power = np.cumsum(density[1:]) * float(frequencies[1] - frequencies[0])
    return frequencies[1:], np.sqrt(power)


def segment_of(samples: int, sample_time: float, resolution: float) -> int:
    """Return the samples per segment for a resolution [Hz] in a record of given length."""
    return min(samples, max(4, round(1.0 / (resolution * sample_time))))


def error_by_source(complete: ArrayLike, without: Mapping[str, ArrayLike]) -> dict[str, float]:
    """
    Return the contribution of each disturbance source to the TMR, from runs without that source.

    In a linear loop the variances of independent sources add up, so that the contribution of a source is 3 times the
    root of the variance with all sources minus the variance without that source.

    Parameters
    ----------
    complete
        Position error of the run with all sources, after the transient, shape (n,).
    without
        Position error of the run without a source, by the name of the source, shape (m,).

    Returns
    -------
    dict
        3 sigma by source in the unit of the errors; ``rest`` is the part that no source explains, such as sensor noise.
        A negative value is minus the root of a negative difference, for a source that reduces the error.

    Raises
    ------
    ValueError
        If a source is named ``rest``.
    """
    return shares_by_source(
        standard_deviation(complete), {name: standard_deviation(error) for name, error in without.items()}
    )


def shares_by_source(complete: float, without: Mapping[str, float]) -> dict[str, float]:
    """Return the result of :func:`error_by_source` from the standard deviations of the errors."""
    if 'rest' in without:
        raise ValueError("a source cannot be named 'rest', which is the part that no source explains")
    variance = complete**2
    shares = {name: variance - deviation**2 for name, deviation in without.items()}
    shares['rest'] = variance - sum(shares.values())
    return {name: 3.0 * float(np.copysign(np.sqrt(abs(share)), share)) for name, share in shares.items()}
