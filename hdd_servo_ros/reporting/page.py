"""
Plots and tables as one self-contained HTML page: no network, no server, no other file.

The page includes plotly.js, the samples as base64 of 32-bit numbers, and times as integer ticks, so that a run of any
length gives a page of about 5 MB.
"""

import base64
import dataclasses
import datetime as dt
import html
import json
import math
import string
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from hdd_servo_ros.reporting.panel import BAR_WIDTH, SHADE_OPACITY, Panel, Shade, Trace

_PANEL_HEIGHT = 260
_TALL_HEIGHT = 420
_SPLIT = (0.63, 0.7)
"""End of the full plot and start of the close-up, as fractions of the width of the figure."""
_MANY_POINTS = 20_000
_MANY_SHADES = 1000
"""Largest number of shaded intervals: each is a separate shape, and more would not be visible."""
_MARK = '! '
"""Prefix of a highlighted table cell."""


def write_page(
    path: Path,
    title: str,
    subtitle: str,
    table: tuple[Sequence[str], Sequence[Sequence[str]]],
    panels: Sequence[Panel],
    sample_time: float,
    details: Mapping[str, Sequence[Sequence[str]]],
) -> None:
    """
    Write the page.

    Parameters
    ----------
    path
        File, which is written atomically.
    title, subtitle
        Heading of the page.
    table
        Header and rows of the table of metrics.
    panels
        The plots; the time plots share one axis, and their close-ups another.
    sample_time
        Sample time T [s].
    details
        Tables after the plots, each collapsed under its title.
    """
    template = string.Template((files(__package__) / 'page.html').read_text('utf8'))
    text = template.substitute(
        title=html.escape(title),
        subtitle=html.escape(subtitle),
        table=_table(*table),
        figures=in_script(_figures(panels, sample_time)),
        details=''.join(_details(name, lines) for name, lines in details.items()),
        written=html.escape(f'{dt.datetime.now():%Y-%m-%d %H:%M}'),
        plotly=get_plotlyjs(),
    )
    temporary = path.with_suffix('.html.tmp')
    temporary.write_text(text, 'utf8')
    temporary.replace(path)


def in_script(value: object) -> str:
    """Return JSON in which no string can end a script, or start a comment or a script in it."""
    text = json.dumps(value, ensure_ascii=True)
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')


def _figures(panels: Sequence[Panel], sample_time: float) -> list[dict[str, Any]]:
    """Return the figures for plotly.js: one with all time plots, and one per other panel."""
    over_time = [panel for panel in panels if panel.over_time]
    figures = [_figure(over_time, sample_time)] if over_time else []
    return figures + [_figure([panel], sample_time) for panel in panels if not panel.over_time]


def _figure(panels: Sequence[Panel], sample_time: float) -> dict[str, Any]:
    """Return stacked panels with a common horizontal axis, and their close-ups on the right."""
    count = len(panels)
    gap = 0.28 / count
    height = (1.0 - gap * (count - 1)) / count
    total = _PANEL_HEIGHT * count + 60 if panels[0].over_time else _TALL_HEIGHT
    layout: dict[str, Any] = {'height': total, 'annotations': [], 'shapes': []}
    data: list[dict[str, Any]] = []
    has_close_up = any(panel.close_up is not None for panel in panels)
    for index, panel in enumerate(panels):
        top = 1.0 - index * (height + gap)
        vertical = [max(0.0, top - height), top]
        whole = _Axes(_number(index), _number(0), [0.0, _SPLIT[0]] if has_close_up else [0.0, 1.0], vertical)
        layout |= whole.layout(panel, panel.traces) | {f'legend{whole.number}': {'y': top, 'yanchor': 'top'}}
        layout[f'yaxis{whole.number}']['title'] = {'text': html.escape(panel.y_label)}
        layout['annotations'].append(_title(panel.title, 0.0, top))
        data += whole.lines(panel, panel.traces, sample_time, legend=f'legend{whole.number}')
        layout['shapes'] += whole.shades(panel.shades, legend=f'legend{whole.number}')
        if panel.close_up is not None:
            first = next(number for number, other in enumerate(panels) if other.close_up is not None)
            close_up = _Axes(_number(count + index), _number(count + first), [_SPLIT[1], 1.0], vertical)
            layout |= close_up.layout(panel, panel.in_close_up())
            layout[f'xaxis{close_up.number}']['range'] = [panel.close_up.start, panel.close_up.end]
            layout['annotations'].append(_title(panel.close_up.title, _SPLIT[1], top))
            data += close_up.lines(panel, panel.in_close_up(), sample_time, legend=None)
            layout['shapes'] += close_up.shades(panel.shades_in_close_up(), legend=None)
    return {'data': data, 'layout': layout}


def _number(index: int) -> str:
    """Return the suffix of an axis name in plotly.js."""
    return '' if index == 0 else str(index + 1)


@dataclasses.dataclass(frozen=True)
class _Axes:
    """A pair of axes of a figure: its number, the number of the axis whose zoom it follows, and its domain."""

    number: str
    followed: str
    horizontal: list[float]
    vertical: list[float]

    def layout(self, panel: Panel, traces: Sequence[Trace]) -> dict[str, Any]:
        """Return the layout of the axes."""
        log = {'type': 'log', 'dtick': 1}
        x: dict[str, Any] = {'anchor': f'y{self.number}', 'domain': self.horizontal}
        # plotly.js interprets some tags and all entities in strings.
        x['title'] = {'text': html.escape(panel.x_label), 'standoff': 4}
        if panel.categories:
            x |= {
                'tickvals': list(range(len(panel.categories))),
                'ticktext': [html.escape(text) for text in panel.categories],
            }
        if self.followed != self.number:
            x['matches'] = f'x{self.followed}'
        y: dict[str, Any] = {'anchor': f'x{self.number}', 'domain': self.vertical, 'exponentformat': 'power'}
        limits = panel.range_of(tuple(traces))
        if limits is not None:
            # On a logarithmic axis plotly.js expects exponents.
            y['range'] = [math.log10(limit) for limit in limits] if panel.has_logarithmic_y else list(limits)
        return {
            f'xaxis{self.number}': x | (log if panel.has_logarithmic_x else {}),
            f'yaxis{self.number}': y | (log if panel.has_logarithmic_y else {}),
        }

    def lines(
        self, panel: Panel, traces: Sequence[Trace], sample_time: float, legend: str | None
    ) -> list[dict[str, Any]]:
        """Return lines in drawing order; a click in the legend also hides the line in the close-up."""
        return [
            {
                'type': 'scattergl' if len(traces[index].x) > _MANY_POINTS else 'scatter',
                'name': html.escape(traces[index].name),
                **_style(traces[index]),
                'legendrank': index + 1,
                'legendgroup': f'{panel.name}, {index}',
                'showlegend': legend is not None and not panel.categories,
                'x': _coded_times(traces[index].x, sample_time) if panel.over_time else _coded(traces[index].x),
                'y': _coded(traces[index].y),
                'xaxis': f'x{self.number}',
                'yaxis': f'y{self.number}',
                **({} if legend is None else {'legend': legend}),
            }
            for index in panel.drawing_order()
        ]

    def shades(self, shades: Sequence[Shade], legend: str | None) -> list[dict[str, Any]]:
        """Return the shaded intervals of the horizontal axis, with one legend entry per kind."""
        if sum(len(shade.intervals) for shade in shades) > _MANY_SHADES:
            return []
        return [
            {
                'type': 'rect',
                'layer': 'below',
                'xref': f'x{self.number}',
                'yref': f'y{self.number} domain',
                'x0': start,
                'x1': end,
                'y0': 0,
                'y1': 1,
                'fillcolor': shade.color,
                'opacity': SHADE_OPACITY,
                'line': {'width': 0},
                'name': shade.name,
                'showlegend': legend is not None and index == 0,
                **({} if legend is None else {'legend': legend}),
            }
            for shade in shades
            for index, (start, end) in enumerate(shade.intervals.tolist())
        ]


def _style(trace: Trace) -> dict[str, Any]:
    """Return the style of a line."""
    if trace.barred:
        return {'type': 'bar', 'width': BAR_WIDTH, 'marker': {'color': trace.color}}
    if trace.marked:
        drawn: dict[str, Any] = {'mode': 'markers', 'marker': {'color': trace.color}}
    else:
        drawn = {'mode': 'lines', 'line': {'color': trace.color, 'width': 4 if trace.wide else 1.2}}
    return drawn | {'opacity': trace.opacity}


def _title(text: str, left: float, top: float) -> dict[str, Any]:
    position = {'x': left, 'xref': 'paper', 'xanchor': 'left', 'y': top, 'yref': 'paper', 'yanchor': 'bottom'}
    return {'text': f'<b>{html.escape(text)}</b>', 'showarrow': False, **position}


def _coded(values: NDArray[np.float64]) -> dict[str, Any]:
    return {'f4': _base64(values, '<f4')}


def _coded_times(values: NDArray[np.float64], sample_time: float) -> dict[str, Any]:
    return {'scale': sample_time, 'i4': _base64(np.rint(values / sample_time), '<i4')}


def _base64(values: NDArray[np.float64], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    cells = ''.join(f'<th>{html.escape(text)}</th>' for text in head)
    return f'<table class="metrics"><thead><tr>{cells}</tr></thead><tbody>{_rows(lines)}</tbody></table>'


def _details(name: str, lines: Sequence[Sequence[str]]) -> str:
    return f'<details><summary>{html.escape(name)}</summary><table>{_rows(lines)}</table></details>'


def _rows(lines: Sequence[Sequence[str]]) -> str:
    """Return the rows of a table; the first cell of each row is its heading."""
    return ''.join(
        f'<tr><th>{html.escape(line[0])}</th>{"".join(_cell(text) for text in line[1:])}</tr>' for line in lines
    )


def _cell(text: str) -> str:
    kind = ' class="marked"' if text.startswith(_MARK) else ''
    return f'<td{kind}>{html.escape(text)}</td>'
