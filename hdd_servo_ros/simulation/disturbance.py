"""What disturbs the drive from outside, as the loop takes it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class DisturbanceSource(Protocol):
    """A disturbance that does not depend on the loop, so that the rows of many ticks can be made at once."""

    def rows(self, first_tick: int, count: int) -> NDArray[np.float64]:
        """Return what `/disturbance` carries at consecutive ticks: force against u [V], 0, 0; shape (count, 3)."""
