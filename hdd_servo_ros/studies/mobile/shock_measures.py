"""What is measured on a run with a shock."""

import numpy as np
from numpy.typing import NDArray

BEFORE = 0.05
"""The loop has settled this long before the shock [s]."""
LIMIT = 100.0
"""About a tenth of the thesis's track pitch [nm]."""


def peak_and_time(error: NDArray[np.float64], sample_time: float) -> tuple[float, float]:
    """Return the largest |error| [nm] and the time for which it is beyond ``LIMIT`` [ms]."""
    magnitude = np.abs(error)
    return float(magnitude.max()), 1e3 * sample_time * int(np.count_nonzero(~(magnitude <= LIMIT)))
