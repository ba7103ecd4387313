"""Live plots of a run, from the decimated blocks that its recorder publishes."""

from collections import deque

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hdd_servo_ros.messages.scope_blocks import ERROR, TIME, Block, column_name
from hdd_servo_ros.messages.signals import TimedSignals
from hdd_servo_ros.messages.topics import ESTIMATES
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.reporting.loop_panels import loop_panels
from hdd_servo_ros.reporting.plot import Stack
from hdd_servo_ros.reporting.seek_view import view_of_estimates

Array = NDArray[np.float64]


class BlockSignals(TimedSignals):
    """
    The signals of a run in decimated blocks.

    A row is not a tick: it has the extremes of a bin. The error therefore has its own column: the difference of two
    extremes is not the extreme of the difference.

    Parameters
    ----------
    names
        Names of the columns, in the order of :func:`~hdd_servo_ros.messages.scope_blocks.make_block`.
    rows
        Rows in time order, shape (n, m).
    units
        Units of the drive.
    """

    def __init__(self, names: tuple[str, ...], rows: Array, units: Units) -> None:
        self._columns: dict[str, Array] = dict(zip(names, rows.T, strict=True))
        self._units = units

    @property
    def time(self) -> Array:
        """Time of each row [s], shape (n,)."""
        return self._columns[TIME]

    @property
    def units(self) -> Units:
        """Units of the drive."""
        return self._units

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """Names of the columns of ``signals['estimates']``, without the time."""
        prefix = column_name(ESTIMATES, '')
        return tuple(name.removeprefix(prefix) for name in self._columns if name.startswith(prefix))

    def __getitem__(self, topic: str) -> Array:
        """Return the fields of a topic by its name; raises KeyError for an unknown topic."""
        columns = [rows for name, rows in self._columns.items() if name.startswith(f'{topic}.')]
        if not columns:
            raise KeyError(topic)
        return np.column_stack(columns)

    def __contains__(self, topic: str) -> bool:
        """Return whether the blocks have a topic."""
        return any(name.startswith(f'{topic}.') for name in self._columns)

    @property
    def position_error(self) -> Array:
        """Position error [um]."""
        return self._columns[ERROR]


class LiveView:
    """
    Plots the most recent blocks.

    Parameters
    ----------
    figure
        The figure.
    window
        Length of the time axis [s].
    """

    def __init__(self, figure: Figure, window: float) -> None:
        self._stack = Stack(figure)
        self._window = window
        self._blocks: deque[Block] = deque()
        self._units = Units()

    def add(self, block: Block, units: Units) -> None:
        """Add a block, and drop rows older than the window."""
        if self._blocks and block.names != self._blocks[-1].names:
            self._blocks.clear()
        self._units = units
        self._blocks.append(block)
        while self._blocks[0].rows[-1, 0] < block.rows[-1, 0] - self._window:
            self._blocks.popleft()

    @property
    def is_empty(self) -> bool:
        """Whether no block has arrived yet."""
        return not self._blocks

    def draw(self) -> None:
        """Draw the blocks."""
        if self.is_empty:
            return
        rows = np.concatenate([block.rows for block in self._blocks])
        rows = rows[rows[:, 0] >= rows[-1, 0] - self._window]
        signals = BlockSignals(self._blocks[-1].names, rows, self._units)
        self._stack.draw(loop_panels(signals, follows=True, seeks=view_of_estimates(signals)))


def lighten() -> None:
    """Let matplotlib simplify paths below the resolution of a screen."""
    mpl.rcParams.update({'path.simplify': True, 'path.simplify_threshold': 1.0, 'agg.path.chunksize': 10_000})
