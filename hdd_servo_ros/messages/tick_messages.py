"""Interface between packing and writing the messages of many ticks."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Messages = NDArray[np.uint8]
"""Serialized messages of one size, shape (n, size)."""


class TickMessages(Protocol):
    """
    One message per topic and tick, for n ticks; all messages of a topic have the same size.

    The messages are packed directly into the memory from which they are written to disk, without a copy.
    """

    @property
    def times(self) -> NDArray[np.int64]:
        """Receive time of each tick's messages [ns], shape (n,)."""

    @property
    def templates(self) -> Sequence[bytes]:
        """Per topic, a message of the right size with the bytes that never change."""

    def fill(self, ticks: slice, payloads: Sequence[Messages]) -> None:
        """
        Fill in copies of the templates.

        Parameters
        ----------
        ticks
            Slice of the n ticks.
        payloads
            Per topic the copies, shape (number of ticks, size); the rows need not be contiguous.
        """
