"""
Diagrams and tables as one HTML page that needs nothing else: no network, no server, no other file.

The page holds plotly.js itself and the samples as base64 of 32-bit numbers, times as whole ticks, so that a run of any
length makes a page of about five megabytes.
"""

import base64
import datetime as dt
import html
import json
import string
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from hdd_servo_ros.reporting.panels import Panel

_PANEL_HEIGHT = 260
_TALL_HEIGHT = 420


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
        File to write; it lands by rename.
    title, subtitle
        What stands at the top.
    table
        Head and lines of the table of metrics.
    panels
        The diagrams; those over time share one axis.
    sample_time
        T [s], the step of the times.
    details
        Tables behind the diagrams, each folded away under its title.
    """
    template = string.Template((files(__package__) / 'page.html').read_text('utf8'))
    text = template.substitute(
        title=html.escape(title),
        subtitle=html.escape(subtitle),
        table=_table(*table),
        figures=json.dumps(_figures(panels, sample_time), ensure_ascii=True).replace('</', '<\\/'),
        details=''.join(_details(name, lines) for name, lines in details.items()),
        written=html.escape(f'{dt.datetime.now():%Y-%m-%d %H:%M}'),
        plotly=get_plotlyjs(),
    )
    temporary = path.with_suffix('.html.tmp')
    temporary.write_text(text, 'utf8')
    temporary.replace(path)


def _figures(panels: Sequence[Panel], sample_time: float) -> list[dict[str, Any]]:
    """Return what plotly.js draws: one figure of all panels over time, one of each other panel."""
    over_time = [panel for panel in panels if panel.over_time]
    figures = [_time_figure(over_time, sample_time)] if over_time else []
    return figures + [_figure(panel) for panel in panels if not panel.over_time]


def _time_figure(panels: Sequence[Panel], sample_time: float) -> dict[str, Any]:
    count = len(panels)
    gap = 0.28 / count
    height = (1.0 - gap * (count - 1)) / count
    layout: dict[str, Any] = {'height': _PANEL_HEIGHT * count + 60, 'annotations': []}
    data = []
    for place, panel in enumerate(panels):
        number = '' if place == 0 else str(place + 1)
        top = 1.0 - place * (height + gap)
        layout[f'xaxis{number}'] = {
            'anchor': f'y{number}',
            'title': {'text': panel.x_label, 'standoff': 4},
            **({'matches': 'x'} if place else {}),
        }
        layout[f'yaxis{number}'] = {
            'anchor': f'x{number}',
            'domain': [max(0.0, top - height), top],
            'title': {'text': panel.y_label},
        }
        layout[f'legend{number}'] = {'y': top, 'yanchor': 'top'}
        layout['annotations'].append(_title(panel.title, top))
        for trace in panel.traces:
            ticks = {'scale': sample_time, 'i4': _base64(np.rint(trace.x / sample_time), '<i4')}
            line = _line(trace, ticks)
            line |= {'xaxis': f'x{number}', 'yaxis': f'y{number}', 'legend': f'legend{number}'}
            data.append(line)
    return {'data': data, 'layout': layout}


def _figure(panel: Panel) -> dict[str, Any]:
    log = {'type': 'log', 'dtick': 1}
    x_kind = log if panel.logarithmic or panel.logarithmic_x else {}
    y_kind: dict[str, Any] = {'exponentformat': 'power', **(log if panel.logarithmic else {})}
    if panel.y_range is not None:
        y_kind['range'] = panel.y_range
    return {
        'data': [_line(trace, {'f4': _base64(trace.x, '<f4')}) for trace in panel.traces],
        'layout': {
            'height': _TALL_HEIGHT,
            'annotations': [_title(panel.title, 1.0)],
            'xaxis': {'title': {'text': panel.x_label}, **x_kind},
            'yaxis': {'title': {'text': panel.y_label}, **y_kind},
        },
    }


def _line(trace: Any, x: dict[str, Any]) -> dict[str, Any]:
    return {
        'type': 'scattergl' if len(trace.x) > 20_000 else 'scatter',
        'mode': 'lines',
        'name': trace.name,
        'line': {'color': trace.colour, 'width': 4 if trace.wide else 1.2},
        'opacity': 0.6 if trace.wide else 1.0,
        'showlegend': True,
        'x': x,
        'y': {'f4': _base64(trace.y, '<f4')},
    }


def _title(text: str, top: float) -> dict[str, Any]:
    place = {'x': 0.0, 'xref': 'paper', 'xanchor': 'left', 'y': top, 'yref': 'paper', 'yanchor': 'bottom'}
    return {'text': f'<b>{html.escape(text)}</b>', 'showarrow': False, **place}


def _base64(values: NDArray[np.float64], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    cells = ''.join(f'<th>{html.escape(text)}</th>' for text in head)
    return f'<table class="metrics"><thead><tr>{cells}</tr></thead><tbody>{_rows(lines)}</tbody></table>'


def _details(name: str, lines: Sequence[Sequence[str]]) -> str:
    return f'<details><summary>{html.escape(name)}</summary><table>{_rows(lines)}</table></details>'


def _rows(lines: Sequence[Sequence[str]]) -> str:
    """Return the lines of a table; the first cell of each names it."""
    return ''.join(
        f'<tr><th>{html.escape(line[0])}</th>{"".join(f"<td>{html.escape(text)}</td>" for text in line[1:])}</tr>'
        for line in lines
    )
