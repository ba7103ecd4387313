"""Interface between what packs the messages of many ticks and what writes them."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Messages = NDArray[np.uint8]
"""Serialized messages of one size, shape (n, size)."""


class TickMessages(Protocol):
    """
    One message per topic and tick, for n ticks; the messages of a topic all have one size.

    The messages are made in the memory from which they are written to disk, so no copy is made of them.
    """

    @property
    def times(self) -> NDArray[np.int64]:
        """Receive time of each tick's messages [ns], shape (n,)."""

    @property
    def templates(self) -> Sequence[bytes]:
        """For each topic, a message of the right size that holds the bytes that never change."""

    def fill(self, ticks: slice, payloads: Sequence[Messages]) -> None:
        """
        Complete copies of the templates.

        Parameters
        ----------
        ticks
            Which of the n ticks.
        payloads
            For each topic the copies, shape (number of ticks, size), whose rows may lie apart.
        """
