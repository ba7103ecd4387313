"""
Track misregistration (thesis eqs. 1.1, 1.2): three times the standard deviation of the position error signal.

The thesis prints eq. 1.1 with a cube root instead of a square root; eq. 1.2 as printed holds only for zero mean.
"""

import numpy as np
import numpy.typing as npt


def standard_deviation(position_error: npt.ArrayLike) -> float:
    """Return sigma_pes (thesis eq. 1.2, corrected): the root of sum (y - mean)^2 / (N - 1), in the signal unit."""
    return float(np.std(np.asarray(position_error, dtype=np.float64), ddof=1))


def misregistration(position_error: npt.ArrayLike) -> float:
    """Return TMR = 3 sigma_pes from a record of the position error signal."""
    return 3.0 * standard_deviation(position_error)


def misregistration_from_spectrum(frequencies: npt.ArrayLike, density: npt.ArrayLike) -> float:
    """
    Return the TMR (thesis eq. 1.1, corrected): 3 times the root of the integral of the one-sided density.

    Parameters
    ----------
    frequencies
        Frequencies [Hz], increasing.
    density
        One-sided power spectral density [squared unit of the signal per Hz].
    """
    f = np.asarray(frequencies, dtype=np.float64)
    p = np.asarray(density, dtype=np.float64)
    return 3.0 * float(np.sqrt(np.sum(0.5 * (p[1:] + p[:-1]) * np.diff(f))))
