"""The control of a long run, summed up block by block."""

import numpy as np

from hdd_servo_ros.analysis.streamed_sums import StreamedLoopArea, StreamedVariation
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.topics import HEAD
from hdd_servo_ros.reporting.long_errors import LongSignal


class LongControl:
    """
    The control of a long run after its transient, and the areas that it encloses over the position.

    Parameters
    ----------
    start
        Row from which it counts.
    area_rows
        The rows of whole cycles of the reference, whose areas are wanted; empty for none.
    cycles
        How many cycles these are.
    """

    def __init__(self, start: int, area_rows: range, cycles: int) -> None:
        self.peak = 0.0
        """Largest magnitude, over the whole run."""
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
        """Area of a cycle of the control over the position, and of its feedback part."""
        whole, feedback = (area.area(self.cycles) for area in self._areas)
        return whole, feedback
