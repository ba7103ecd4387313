"""Measures of a run with a shock."""

import numpy as np
from numpy.typing import NDArray

BEFORE = 0.05
"""Time before the shock at which the loop has settled [s]."""
LIMIT = 100.0
"""Error limit: about a tenth of the track pitch in the thesis [nm]."""


def peak_and_time(error: NDArray[np.float64], sample_time: float) -> tuple[float, float]:
    """Return the peak error [nm] and the time for which the error exceeds ``LIMIT`` [ms]."""
    magnitude = np.abs(error)
    return float(magnitude.max()), 1e3 * sample_time * int(np.count_nonzero(~(magnitude <= LIMIT)))
