"""A plot as data, for image files, the report page and the live view."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

COLORS = ('#1f77b4', '#d62728', '#2ca02c', '#ff7f0e', '#9467bd', '#17becf', '#8c564b', '#e377c2', '#bcbd22', '#7f7f7f')
GRAY = '#999999'
BAR_WIDTH = 0.6
"""Width of a bar as a fraction of the distance of two bars."""
SHADE_OPACITY = 0.5
_MARGIN = 0.05
"""Free space below and above the lines, as a fraction of their span."""


@dataclasses.dataclass(frozen=True)
class Trace:
    """
    One line of a plot.

    Attributes
    ----------
    name
        Name in the legend.
    x, y
        Points, shape (n,).
    color
        As ``#rrggbb``.
    wide
        Whether it is wide and transparent, for a line that others cover.
    marked
        Whether to draw markers instead of a line.
    clipped
        Whether the line is ignored for the scale of the vertical axis, so that it may be clipped.
    barred
        Whether to draw bars from 0.
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    color: str
    wide: bool = False
    marked: bool = False
    clipped: bool = False
    barred: bool = False

    @property
    def opacity(self) -> float:
        """Opacity from 0 to 1; a clipped line is transparent, since it may fill the plot."""
        if self.clipped:
            return 0.3
        return 0.6 if self.wide else 1.0

    def between(self, start: float, end: float) -> 'Trace':
        """Return the points whose x is in a range."""
        inside = (self.x >= start) & (self.x <= end)
        return dataclasses.replace(self, x=self.x[inside], y=self.y[inside])


@dataclasses.dataclass(frozen=True)
class Shade:
    """
    Shaded intervals of the horizontal axis.

    Attributes
    ----------
    name
        Name in the legend.
    intervals
        Start and end of each interval, shape (m, 2).
    color
        As ``#rrggbb``.
    """

    name: str
    intervals: NDArray[np.float64]
    color: str

    def between(self, start: float, end: float) -> 'Shade':
        """Return the parts within a range."""
        inside = np.clip(self.intervals, start, end)
        return dataclasses.replace(self, intervals=inside[inside[:, 1] > inside[:, 0]])


@dataclasses.dataclass(frozen=True)
class CloseUp:
    """Interval of the horizontal axis that is plotted again at full width next to the whole."""

    start: float
    end: float
    title: str


@dataclasses.dataclass(frozen=True)
class Panel:
    """
    One plot.

    Attributes
    ----------
    name
        Identifier for programs.
    title, x_label, y_label
        Title and axis labels.
    traces
        Its lines.
    over_time
        Whether it is a time plot; time plots are stacked and share their axis.
    logarithmic, logarithmic_x
        Whether both axes, or only the horizontal one, are logarithmic.
    largest_first
        Whether to draw the largest lines first, so that they do not cover the others.
    y_range
        Range of the vertical axis; None to fit the lines.
    close_up
        Close-up next to the whole.
    categories
        Labels at 0, 1, ... of the horizontal axis in place of numbers.
    shades
        Shaded intervals in the background.

    Raises
    ------
    ValueError
        If the range of a logarithmic axis is not positive.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    traces: tuple[Trace, ...]
    over_time: bool = False
    logarithmic: bool = False
    logarithmic_x: bool = False
    largest_first: bool = False
    y_range: tuple[float, float] | None = None
    close_up: CloseUp | None = None
    categories: tuple[str, ...] = ()
    shades: tuple[Shade, ...] = ()

    def __post_init__(self) -> None:
        if self.logarithmic and self.y_range is not None and self.y_range[0] <= 0.0:
            raise ValueError(f'panel {self.name}: a logarithmic axis cannot start at {self.y_range[0]!r}')

    @property
    def has_logarithmic_y(self) -> bool:
        """Whether the vertical axis is logarithmic; not if no line has a positive value."""
        return self.logarithmic and any((trace.y > 0.0).any() for trace in self.traces)

    @property
    def has_logarithmic_x(self) -> bool:
        """Whether the horizontal axis is logarithmic."""
        return self.logarithmic_x or self.has_logarithmic_y

    def in_close_up(self) -> tuple[Trace, ...]:
        """Return the lines within the close-up; all lines without a close-up."""
        if self.close_up is None:
            return self.traces
        return tuple(trace.between(self.close_up.start, self.close_up.end) for trace in self.traces)

    def shades_in_close_up(self) -> tuple[Shade, ...]:
        """Return the shades within the close-up; all shades without a close-up."""
        if self.close_up is None:
            return self.shades
        return tuple(shade.between(self.close_up.start, self.close_up.end) for shade in self.shades)

    def drawing_order(self) -> list[int]:
        """Return the indices of the lines in drawing order."""
        if not self.largest_first:
            return list(range(len(self.traces)))
        # By the interquartile range, which is small for a line that is large only at the start.
        sizes = [float(np.subtract(*np.percentile(trace.y, (75, 25)))) for trace in self.traces]
        order: list[int] = np.argsort(sizes, kind='stable')[::-1].tolist()
        return order

    def range_of(self, traces: tuple[Trace, ...]) -> tuple[float, float] | None:
        """
        Return the range of the vertical axis for lines of this panel, all or those of the close-up.

        None means automatic scaling.
        """
        if self.y_range is not None or not any(trace.clipped for trace in traces):
            return self.y_range
        return fitted_range([trace.y for trace in traces if not trace.clipped], logarithmic=self.has_logarithmic_y)


def fitted_range(values: list[NDArray[np.float64]], *, logarithmic: bool = False) -> tuple[float, float] | None:
    """Return the range that fits finite values with a margin; None without finite values."""
    joined = np.concatenate([np.empty(0), *values])
    joined = joined[np.isfinite(joined) & ((joined > 0.0) | (not logarithmic))]
    if not len(joined):
        return None
    low, high = float(joined.min()), float(joined.max())
    if logarithmic:
        factor = (high / low) ** _MARGIN if high > low else 2.0
        return low / factor, high * factor
    margin = _MARGIN * (high - low) or _MARGIN * abs(high) or math.ulp(1.0)
    return low - margin, high + margin
