"""How the studies draw and write tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hdd_servo_ros.reporting.decimation import rows_to_draw

_PIECES = 2000
"""More than a picture has columns."""


def new_figure(title: str, width: float = 8.5, height: float = 5.0) -> Figure:
    """Return an empty figure that needs no display."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11)
    return figure


def draw(axes: Axes, time: NDArray[np.float64], values: NDArray[np.float64], **style: Any) -> None:
    """Draw a signal over time, of a long one no more than a picture shows, every peak among it."""
    rows = rows_to_draw(values, _PIECES)
    axes.plot(time[rows], values[rows], **{'linewidth': 1.0, **style})


def legend_above(*axes: Axes) -> None:
    """Give axes their legend above the frame, where it hides nothing."""
    for axis in axes:
        axis.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False, borderaxespad=0.2)


def save(figure: Figure, path: Path) -> Path:
    """Give all axes a grid, write the figure as PNG, and return its file."""
    for axes in figure.axes:
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
    file = path.with_suffix('.png')
    figure.savefig(file, dpi=100)
    return file


def write_table(path: Path, title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    """Write a Markdown table, numbers with three digits, and return its file."""
    lines = [title, '', _row(header), '|' + '---|' * len(header), *(_row(row) for row in rows)]
    file = path.with_suffix('.md')
    file.write_text('\n'.join(lines) + '\n', 'utf8')
    return file


def _row(cells: Sequence[object]) -> str:
    return '| ' + ' | '.join(f'{cell:.3g}' if isinstance(cell, float) else str(cell) for cell in cells) + ' |'
