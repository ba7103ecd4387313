"""What disturbs the drive from outside, as the loop takes it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.topics import LoopTopic


class DisturbanceSource(Protocol):
    """A disturbance that does not depend on the loop, so that the rows of many ticks can be made at once."""

    @property
    def topics(self) -> tuple[LoopTopic, ...]:
        """The topics that it fills: `/disturbance`, `/base_acceleration` or both."""

    def rows(self, first_tick: int, count: int) -> Sequence[NDArray[np.float64]]:
        """
        Return what consecutive ticks carry on each of :attr:`topics`, shape (count, width of the topic).

        Of `/disturbance` that is force against u [V], displacement of the track center [um], 0; of
        `/base_acceleration` the linear [m/s^2] and angular [rad/s^2] acceleration along and about x, y, z.
        """
