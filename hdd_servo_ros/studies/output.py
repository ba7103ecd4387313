"""Figures and tables of the studies: drawing and writing."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hdd_servo_ros.reporting.decimation import rows_to_draw

_BUCKETS = 2000
"""Number of buckets for the decimation of a signal: more than a figure has pixel columns."""


def new_figure(title: str, width: float = 8.5, height: float = 5.0) -> Figure:
    """Return an empty figure that needs no display."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11)
    return figure


def draw(axes: Axes, time: NDArray[np.float64], values: NDArray[np.float64], **style: Any) -> None:
    """Draw a signal over time, decimated to the resolution of the figure with all peaks kept."""
    rows = rows_to_draw(values, _BUCKETS)
    axes.plot(time[rows], values[rows], **{'linewidth': 1.0, **style})


def legend_above(*axes: Axes) -> None:
    """Add a legend above the frame of each axes, where it hides no data."""
    for axis in axes:
        axis.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False, borderaxespad=0.2)


def save(figure: Figure, path: Path) -> Path:
    """Add a grid to all axes, write the figure as PNG, and return the file."""
    for axes in figure.axes:
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
    file = path.with_suffix('.png')
    figure.savefig(file, dpi=100)
    return file


def write_table(path: Path, title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    """Write a Markdown table with numbers of three digits, and return the file."""
    lines = [title, '', _row(header), '|' + '---|' * len(header), *(_row(row) for row in rows)]
    file = path.with_suffix('.md')
    file.write_text('\n'.join(lines) + '\n', 'utf8')
    return file


def _row(cells: Sequence[object]) -> str:
    return '| ' + ' | '.join(f'{cell:.3g}' if isinstance(cell, float) else str(cell) for cell in cells) + ' |'
