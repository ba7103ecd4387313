"""How the studies draw and write tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

_POINTS = 2000
"""Columns of a long signal: more than a picture has pixels."""


def new_figure(title: str, width: float = 8.5, height: float = 5.0) -> Figure:
    """Return an empty figure that needs no display."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11)
    return figure


def draw(axes: Axes, time: NDArray[np.float64], values: NDArray[np.float64], **style: Any) -> None:
    """Draw a signal over time; a long one through the extremes of each piece, so that no peak is lost."""
    piece = -(-len(time) // _POINTS)
    if piece > 2:
        starts = np.arange(0, len(time), piece)
        low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
        time, values = np.repeat(time[starts], 2), np.column_stack((low, high)).ravel()
    axes.plot(time, values, **{'linewidth': 1.0, **style})


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
