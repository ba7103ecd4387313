"""Interface of an external disturbance of the loop."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.topics import LoopTopic


class DisturbanceSource(Protocol):
    """Disturbance that does not depend on the loop, so that the rows of many ticks can be computed in advance."""

    @property
    def topics(self) -> tuple[LoopTopic, ...]:
        """Topics of the source: ``/disturbance``, ``/base_acceleration`` or both."""

    def rows(self, first_tick: int, count: int) -> Sequence[NDArray[np.float64]]:
        """
        Return the rows of consecutive ticks for each of :attr:`topics`, shape (count, width of the topic).

        The columns of ``/disturbance`` are force against u [V], displacement of the track center [um] and 0. Those of
        ``/base_acceleration`` are linear [m/s^2] and angular [rad/s^2] acceleration along and about x, y, z.
        """
