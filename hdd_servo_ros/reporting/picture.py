"""Diagrams as a picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hdd_servo_ros.reporting.panels import Panel

_COLUMNS = 2
_LEGEND_LINES = 8
_LEGEND_COLUMNS = 3


def write_picture(panels: Sequence[Panel], title: str, path: Path) -> None:
    """Draw diagrams, two a line, into a PNG file."""
    lines = -(-len(panels) // _COLUMNS)
    # Not pyplot: a picture into a file needs no display, and no choice of one for the whole process.
    figure = Figure(figsize=(13, 3.3 * lines + 0.4), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(lines, _COLUMNS, squeeze=False).ravel()
    for axis, panel in zip(axes, panels, strict=False):
        _draw(axis, panel)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    figure.suptitle(title)
    figure.savefig(path, dpi=100)


def _draw(axis: Axes, panel: Panel) -> None:
    order = _order(panel)
    for trace, rank in zip(panel.traces, order, strict=True):
        x, y = trace.x, trace.y
        if panel.close_up is not None:
            inside = (x >= panel.close_up[0]) & (x <= panel.close_up[1])
            x, y = x[inside], y[inside]
        width, alpha = (2.6, 0.6) if trace.wide else (0.9, 1.0)
        line, marker = ('', 'o') if trace.marked else ('-', '')
        axis.plot(
            *(x, y, line),
            marker=marker,
            color=trace.colour,
            label=trace.name,
            linewidth=width,
            alpha=alpha,
            zorder=2.0 + rank / len(order),
        )
    # An error of exactly nothing has no logarithm.
    if panel.logarithmic and any((trace.y > 0.0).any() for trace in panel.traces):
        axis.set_xscale('log')
        axis.set_yscale('log')
    elif panel.logarithmic_x:
        axis.set_xscale('log')
    if panel.y_range is not None:
        axis.set_ylim(panel.y_range)
    named = 1 < len(panel.traces) <= _LEGEND_LINES
    # The legend stands between title and frame, where it hides nothing.
    lines = -(-len(panel.traces) // _LEGEND_COLUMNS) if named else 0
    axis.set_title(panel.title + (', last periods' if panel.close_up else ''), fontsize=10, pad=6.0 + 11.0 * lines)
    axis.set_xlabel(panel.x_label, fontsize=9)
    axis.set_ylabel(panel.y_label, fontsize=9)
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.3)
    axis.margins(x=0.01)
    if named:
        axis.legend(
            loc='lower center',
            bbox_to_anchor=(0.5, 1.0),
            borderaxespad=0.2,
            ncols=_LEGEND_COLUMNS,
            fontsize=7,
            frameon=False,
        )


def _order(panel: Panel) -> list[int]:
    """Return when to draw each line: the largest first, or as they come."""
    if not panel.largest_first:
        return list(range(len(panel.traces)))
    # By its middle half, which is small for a line that is large at the start alone.
    sizes = [float(np.subtract(*np.percentile(trace.y, (75, 25)))) for trace in panel.traces]
    largest_first = np.argsort(sizes, kind='stable')[::-1].tolist()
    return [largest_first.index(place) for place in range(len(panel.traces))]
