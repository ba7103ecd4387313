"""
Track misregistration (1.1), (1.2): three times the standard deviation of the position error signal.

(1.1) is printed with a cube root and is a square root; (1.2) as printed holds for a zero-mean signal only.
"""

import numpy as np
import numpy.typing as npt


def standard_deviation(position_error: npt.ArrayLike) -> float:
    """Return sigma_pes of (1.2), corrected: the root of sum (y - mean)^2 / (N - 1), in the unit of the signal."""
    return float(np.std(np.asarray(position_error, dtype=np.float64), ddof=1))


def misregistration(position_error: npt.ArrayLike) -> float:
    """Return TMR = 3 sigma_pes from a record of the position error signal."""
    return 3.0 * standard_deviation(position_error)


def misregistration_from_spectrum(frequencies: npt.ArrayLike, density: npt.ArrayLike) -> float:
    """
    Return TMR of (1.1), corrected: 3 times the root of the integral of the one-sided power spectral density.

    Parameters
    ----------
    frequencies
        Frequencies [Hz], increasing.
    density
        One-sided power spectral density there, in the signal's unit squared per Hz.
    """
    f = np.asarray(frequencies, dtype=np.float64)
    p = np.asarray(density, dtype=np.float64)
    return 3.0 * float(np.sqrt(np.sum(0.5 * (p[1:] + p[:-1]) * np.diff(f))))
