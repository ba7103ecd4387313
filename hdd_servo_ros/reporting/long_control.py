"""Command statistics of a long run, computed block by block."""

import numpy as np

from hdd_servo_ros.analysis.streamed_sums import StreamedLoopArea, StreamedVariation
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.topics import HEAD
from hdd_servo_ros.reporting.long_errors import LongSignal


class LongControl:
    """
    Statistics of the command after the transient, and the loop areas over the position.

    Parameters
    ----------
    start
        First row after the transient.
    area_rows
        Rows of complete reference cycles for the areas; empty for none.
    cycles
        Number of these cycles.
    """

    def __init__(self, start: int, area_rows: range, cycles: int) -> None:
        self.peak = 0.0
        """Peak of the command over the whole run."""
        self.size = LongSignal()
        self.variation = StreamedVariation()
        self._start, self._area_rows, self.cycles = start, area_rows, cycles
        self._areas = StreamedLoopArea(), StreamedLoopArea()

    def add(self, block: SignalRows) -> None:
        """Add the rows of the next block."""
        late = slice(max(self._start - block.first_tick, 0), None)
        self.peak = float(np.maximum(self.peak, np.abs(block.command).max()))
        self.size.add(block.command[late])
        self.variation.add(block.command[late])
        if self._area_rows and HEAD.name in block:
            rows = slice(max(self._area_rows.start - block.first_tick, 0), None)
            for area, force in zip(self._areas, (block.command, block.feedback), strict=True):
                area.add(block.position[rows], force[rows])

    @property
    def areas(self) -> tuple[float, float]:
        """Loop area per cycle of the command over the position, and of its feedback part."""
        whole, feedback = (area.area(self.cycles) for area in self._areas)
        return whole, feedback
