"""A picture of a run that goes on: position, error, control and estimates over the last stretch of time."""

from collections import deque

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hdd_servo_ros.messages.scope_blocks import NAMES, Block

_SHOWN_ESTIMATES = 6
_HIDDEN_ESTIMATES = ('r', 'e')


class LivePlot:
    """
    Draws the newest of the blocks it was given.

    Parameters
    ----------
    figure
        Where to draw.
    window
        How much of the run's time to show [s].
    """

    def __init__(self, figure: Figure, window: float) -> None:
        self._figure = figure
        self._window = window
        self._blocks: deque[Block] = deque()
        self._axes: list[Axes] = list(figure.subplots(4, 1, sharex=True))
        figure.set_layout_engine('constrained')
        self._length_unit, self._control_unit = 'um', 'V'

    def add(self, block: Block, length_unit: str, control_unit: str) -> None:
        """Take in a block; what is older than the window is forgotten."""
        if self._blocks and block.names != self._blocks[-1].names:
            self._blocks.clear()
        self._length_unit, self._control_unit = length_unit, control_unit
        self._blocks.append(block)
        while self._blocks[0].rows[-1, 0] < block.rows[-1, 0] - self._window:
            self._blocks.popleft()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to draw yet."""
        return not self._blocks

    def draw(self) -> None:
        """Draw what there is."""
        if self.is_empty:
            return
        names = self._blocks[-1].names
        rows = np.concatenate([block.rows for block in self._blocks])
        rows = rows[rows[:, 0] >= rows[-1, 0] - self._window]
        signals = dict(zip(names, rows.T, strict=True))
        factor, unit = (1e3, 'nm') if self._length_unit == 'um' else (1.0, self._length_unit)
        panels: list[tuple[str, dict[str, np.ndarray]]] = [
            (f'position [{self._length_unit}]', {'reference': signals['x_d'], 'head': signals['x']}),
            (f'error [{unit}]', {'head - reference': factor * signals['error']}),
            (f'control [{self._control_unit}]', {'total': signals['u'], 'feedback part': signals['feedback']}),
            ('estimates, scaled', self._estimates(signals)),
        ]
        for axes, (label, lines) in zip(self._axes, panels, strict=True):
            axes.clear()
            for name, values in lines.items():
                axes.plot(signals['t'], values, label=name, linewidth=0.9)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
            if lines:
                axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), fontsize='small', ncols=6, frameon=False)
        self._axes[-1].set_xlabel('time of the run [s]')

    @staticmethod
    def _estimates(signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the estimates over their largest magnitudes, which their names tell."""
        names = [name for name in signals if name not in NAMES and name.split('.')[-1] not in _HIDDEN_ESTIMATES]
        scaled: dict[str, np.ndarray] = {}
        for name in names:
            largest = float(np.abs(signals[name]).max())
            if largest > 0.0 and len(scaled) < _SHOWN_ESTIMATES:
                scaled[f'{name.split(".")[-1]} / {largest:.2g}'] = signals[name] / largest
        return scaled


def lighten() -> None:
    """Let matplotlib leave out points that no screen shows."""
    mpl.rcParams.update({'path.simplify': True, 'path.simplify_threshold': 1.0, 'agg.path.chunksize': 10_000})
