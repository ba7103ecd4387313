"""Plots with matplotlib: in an image file, and in a figure that is updated repeatedly."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from hdd_servo_ros.reporting.panel import BAR_WIDTH, SHADE_OPACITY, Panel, Shade

_COLUMNS = 6
"""Columns of the grid: a close-up takes two of them, one of two panels in a row takes three."""
_CLOSE_UP_COLUMNS = 2
_FULL_ROW, _HALVES_ROW = 2.5, 3.3
"""Heights of a row with one panel, and with two [inch]."""
_LEGEND_LINES = 9
_LEGEND_COLUMNS = 3
_LEGEND_ROW = 100
"""Largest number of characters of a legend in one row, with four per symbol; a longer row would displace the plot."""


def write_plot(panels: Sequence[Panel], title: str, path: Path) -> None:
    """
    Write plots to a PNG file.

    A time plot or a plot with a close-up takes a row; the others share rows in pairs.
    """
    rows = list(_rows(panels))
    heights = [_FULL_ROW if _needs_row(row[0]) else _HALVES_ROW for row in rows]
    # Not pyplot: a file needs no display, and no backend for the whole process.
    figure = Figure(figsize=(13, sum(heights) + 0.4 + 0.2 * title.count('\n')), layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(len(rows), _COLUMNS, height_ratios=heights)
    for index, row in enumerate(rows):
        below = rows[index + 1][0] if index + 1 < len(rows) else None
        # Time plots are stacked: only the last one of a stack has an axis label.
        _draw_row(figure, grid, index, row, shows_x=not (row[0].over_time and below is not None and below.over_time))
    figure.suptitle(title)
    figure.savefig(path, dpi=100)


def _needs_row(panel: Panel) -> bool:
    return panel.over_time or panel.close_up is not None


def _rows(panels: Sequence[Panel]) -> Iterator[list[Panel]]:
    """Yield the panels of each row."""
    waiting: list[Panel] = []
    for panel in panels:
        if waiting and (_needs_row(panel) or len(waiting) == 2):
            yield waiting
            waiting = []
        if _needs_row(panel):
            yield [panel]
        else:
            waiting.append(panel)
    if waiting:
        yield waiting


def _draw_row(figure: Figure, grid: GridSpec, index: int, row: Sequence[Panel], *, shows_x: bool) -> None:
    if len(row) == 2:
        half = _COLUMNS // 2
        for panel, columns in zip(row, (slice(0, half), slice(half, None)), strict=True):
            draw_panel(figure.add_subplot(grid[index, columns]), panel)
        return
    (panel,) = row
    split = _COLUMNS if panel.close_up is None else _COLUMNS - _CLOSE_UP_COLUMNS
    draw_panel(figure.add_subplot(grid[index, :split]), panel, shows_x=shows_x, title_next_to_legend=True)
    if panel.close_up is not None:
        draw_panel(figure.add_subplot(grid[index, split:]), panel, close_up=True, shows_x=shows_x)


def draw_panel(
    axis: Axes,
    panel: Panel,
    *,
    close_up: bool = False,
    shows_x: bool = True,
    title_next_to_legend: bool = False,
    is_alone: bool = False,
) -> None:
    """
    Draw one plot.

    Parameters
    ----------
    axis
        Axes or figure.
    panel
        The plot.
    close_up
        Whether to draw the close-up instead of the whole.
    shows_x
        Whether to label the horizontal axis.
    title_next_to_legend
        Whether title and legend fit on one line.
    is_alone
        Whether the close-up has its own legend and vertical label, because the whole is not next to it.
    """
    traces = panel.in_close_up() if close_up else panel.traces
    handles: dict[int, Artist] = {}
    shaded = [_shade(axis, shade) for shade in (panel.shades_in_close_up() if close_up else panel.shades)]
    for rank, index in enumerate(panel.drawing_order()):
        trace = traces[index]
        if trace.barred:
            handles[index] = axis.bar(trace.x, trace.y, width=BAR_WIDTH, color=trace.color, label=trace.name)[0]
            continue
        line, marker = ('none', 'o') if trace.marked else ('-', '')
        (handles[index],) = axis.plot(
            trace.x,
            trace.y,
            linestyle=line,
            marker=marker,
            color=trace.color,
            label=trace.name,
            linewidth=2.6 if trace.wide else 0.9,
            alpha=trace.opacity,
            zorder=2.0 + rank / len(traces),
        )
    if panel.has_logarithmic_x:
        axis.set_xscale('log')
    if panel.has_logarithmic_y:
        axis.set_yscale('log')
    if panel.categories:
        axis.set_xticks(range(len(panel.categories)), panel.categories)
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.3)
    axis.margins(x=0.01)
    limits = panel.range_of(traces)
    if limits is not None:
        axis.set_ylim(limits)
    if shows_x:
        axis.set_xlabel(panel.x_label, fontsize=9)
    title = panel.title
    if close_up and panel.close_up is not None:
        title = f'{title}, {panel.close_up.title}' if is_alone else panel.close_up.title
        if not is_alone:
            axis.set_title(title, fontsize=10)
            return
    axis.set_ylabel(panel.y_label, fontsize=9)
    named = 1 < len(traces) + len(shaded) <= _LEGEND_LINES and not panel.categories
    # The legend is between title and frame, or next to the title, where it covers nothing.
    names = [*(trace.name for trace in traces), *(shade.name for shade in panel.shades)]
    fits = title_next_to_legend and sum(len(name) + 4 for name in names) <= _LEGEND_ROW
    columns = max(_LEGEND_COLUMNS, len(names)) if fits else _LEGEND_COLUMNS
    lines = -(-len(traces) // columns) if named and not title_next_to_legend else 0
    axis.set_title(title, fontsize=10, pad=6.0 + 11.0 * lines, loc='left' if title_next_to_legend else 'center')
    if named:
        axis.legend(
            handles=[*(handles[index] for index in range(len(traces))), *shaded],
            loc='lower right' if title_next_to_legend else 'lower center',
            bbox_to_anchor=(1.0 if title_next_to_legend else 0.5, 1.0),
            borderaxespad=0.2,
            ncols=columns,
            fontsize=7,
            frameon=False,
        )


def _shade(axis: Axes, shade: Shade) -> Artist:
    """Shade intervals of the horizontal axis, and return the artist for the legend."""
    corners = [[(start, 0.0), (start, 1.0), (end, 1.0), (end, 0.0)] for start, end in shade.intervals.tolist()]
    collection = PolyCollection(
        corners,
        facecolors=shade.color,
        edgecolors='none',
        alpha=SHADE_OPACITY,
        label=shade.name,
        transform=axis.get_xaxis_transform(),
        zorder=0.5,
    )
    # The limits are unchanged: only lines scale the axes.
    axis.add_collection(collection, autolim=False)
    return collection


class Stack:
    """
    Stacked time plots in a figure, without close-ups, which can be updated repeatedly.

    Parameters
    ----------
    figure
        Axes or figure.
    """

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._axes: list[Axes] = []
        figure.set_layout_engine('constrained')

    def draw(self, panels: Sequence[Panel]) -> None:
        """Draw panels in place of the previous ones."""
        if len(panels) != len(self._axes):
            self._figure.clear()
            column = self._figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
            self._axes = list(np.ravel(column))[: len(panels)]
        for axis, panel in zip(self._axes, panels, strict=True):
            axis.clear()
            draw_panel(axis, panel, shows_x=axis is self._axes[-1], title_next_to_legend=True)
