"""
The HTML page of a campaign: distributions, scatter plots, parallel coordinates, and commands for the worst runs.

It is one self-contained HTML file that includes plotly.js.
"""

import html
import math
import shlex
import string
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.campaign import Campaign, base_file
from hdd_servo_ros.campaign.kept_runs import run_name
from hdd_servo_ros.campaign.table import Table
from hdd_servo_ros.messages.outcome import FINISHED

WORST = 10
"""Largest number of finished runs, and of unfinished runs, in the table of the worst runs."""
_COLUMNS = 3
_ROW_HEIGHT = 260
_COLORS = ('#1f77b4', '#ff7f0e', '#2ca02c', '#d62728', '#9467bd', '#8c564b', '#e377c2', '#7f7f7f')


def write_page(campaign: Campaign, table: Table, folder: Path) -> Path:
    """
    Write ``campaign.html`` into the directory of a campaign, and return its path.

    Parameters
    ----------
    campaign, table
        The campaign and its table.
    folder
        Its directory.
    """
    # Imported late: only the page needs plotly.
    from plotly.offline import get_plotlyjs

    from hdd_servo_ros.reporting.page import in_script

    metrics = metrics_of(table)
    parameters = [key for key in campaign.plan.varied if table.is_number(key)]
    metric = campaign.worst_metric(table)
    failed = int((table['status'] != FINISHED).sum())
    template = string.Template((files(__package__) / 'page.html').read_text('utf8'))
    text = template.substitute(
        title=html.escape(f'Campaign {campaign.spec.name}'),
        subtitle=html.escape(f'{len(table)} runs, {failed} of which did not finish.'),
        plotly=get_plotlyjs(),
        summary=_summary(table, metrics),
        worst_by=html.escape(
            f'Runs that did not finish, at most {WORST}, then those with the largest absolute value of '
            f'{_label(table, metric)}.'
            if metric
            else f'Runs that did not finish, at most {WORST}; no run has a metric.'
        ),
        worst=_worst(campaign, table, metric, folder),
        check=html.escape(f'ros2 run hdd_servo_ros campaign --check {shlex.quote(str(folder.resolve()))} RUN_DIR'),
        figures=in_script(
            {
                'distributions': _distributions(table, metrics),
                'scatter': _scatter(table, parameters, metric),
                'parallel': _parallel(table, parameters, metrics, metric),
            }
        ),
    )
    path = folder / 'campaign.html'
    temporary = path.with_suffix('.html.tmp')
    temporary.write_text(text, 'utf8')
    temporary.replace(path)
    return path


def metrics_of(table: Table) -> list[str]:
    """Return the metrics that at least one run has."""
    names = table.columns[table.columns.index('last_tick') + 1 : -1]
    return [name for name in names if np.isfinite(table[name]).any()]


def _controllers(table: Table) -> list[str]:
    return list(dict.fromkeys(table['controller'].tolist()))


def _label(table: Table, name: str) -> str:
    unit = table.units.get(name)
    return f'{name} [{unit}]' if unit else name


def _finite(values: NDArray[np.float64]) -> list[float | None]:
    """Return numbers for JSON, with null for those that are not finite."""
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _html_table(head: Sequence[str], lines: Sequence[Sequence[str]], text: Sequence[int] = (0,)) -> str:
    rows = [''.join(f'<th>{html.escape(cell)}</th>' for cell in head)]
    for line in lines:
        cells = (
            f'<td class="text">{cell}</td>' if column in text else f'<td>{cell}</td>'
            for column, cell in enumerate(map(html.escape, line))
        )
        rows.append(''.join(cells))
    return f'<table>{"".join(f"<tr>{row}</tr>" for row in rows)}</table>'


def _summary(table: Table, metrics: Sequence[str]) -> str:
    """Return median, 95th percentile and maximum of each metric, by controller."""
    lines = []
    for name in metrics:
        for controller in _controllers(table):
            values = table.where(controller=controller)[name]
            found = values[np.isfinite(values)]
            shown = [f'{np.quantile(found, share):.4g}' for share in (0.5, 0.95, 1.0)] if len(found) else ['-'] * 3
            lines.append([_label(table, name), controller, *shown, f'{len(found)} of {len(values)}'])
    return _html_table(['metric', 'controller', 'median', '95th percentile', 'largest', 'runs'], lines, (0, 1))


def _grid(titles: Sequence[str]) -> tuple[list[tuple[str, str]], dict[str, Any]]:
    """Return the axes and the layout of a grid of small plots."""
    rows = max(1, -(-len(titles) // _COLUMNS))
    layout: dict[str, Any] = {
        'grid': {'rows': rows, 'columns': _COLUMNS, 'pattern': 'independent'},
        'height': _ROW_HEIGHT * rows + 80,
        'margin': {'t': 30},
    }
    axes = []
    for index, title in enumerate(titles):
        number = '' if index == 0 else str(index + 1)
        axes.append((f'x{number}', f'y{number}'))
        layout[f'xaxis{number}'] = {'title': {'text': html.escape(title)}}
    return axes, layout


def _distributions(table: Table, metrics: Sequence[str]) -> dict[str, Any]:
    axes, layout = _grid([_label(table, name) for name in metrics])
    data = []
    for index, controller in enumerate(_controllers(table)):
        own = table.where(controller=controller)
        for name, (x, y) in zip(metrics, axes, strict=True):
            data.append(
                {
                    'type': 'histogram',
                    'x': _finite(own[name]),
                    'name': html.escape(controller),
                    'legendgroup': str(index),
                    'showlegend': name == metrics[0],
                    'marker': {'color': _COLORS[index % len(_COLORS)]},
                    'opacity': 0.6,
                    'xaxis': x,
                    'yaxis': y,
                }
            )
    return {'data': data, 'layout': {**layout, 'barmode': 'overlay'}}


def _scatter(table: Table, parameters: Sequence[str], metric: str) -> dict[str, Any]:
    if not parameters or not metric:
        return {'data': [], 'layout': {'height': 60}}
    axes, layout = _grid(parameters)
    for _, y in axes:
        layout[f'yaxis{y[1:]}'] = {'title': {'text': html.escape(_label(table, metric))}}
    data = []
    for index, controller in enumerate(_controllers(table)):
        own = table.where(controller=controller)
        for name, (x, y) in zip(parameters, axes, strict=True):
            data.append(
                {
                    'type': 'scattergl',
                    'mode': 'markers',
                    'x': _finite(own[name]),
                    'y': _finite(own[metric]),
                    'text': [f'run {number}' for number in own['run'].tolist()],
                    'name': html.escape(controller),
                    'legendgroup': str(index),
                    'showlegend': name == parameters[0],
                    'marker': {'color': _COLORS[index % len(_COLORS)], 'size': 5},
                    'xaxis': x,
                    'yaxis': y,
                }
            )
    return {'data': data, 'layout': layout}


def _parallel(table: Table, parameters: Sequence[str], metrics: Sequence[str], metric: str) -> dict[str, Any]:
    names = _controllers(table)
    number = {name: index for index, name in enumerate(names)}
    dimensions: list[dict[str, Any]] = [
        {
            'label': 'controller',
            'values': [number[name] for name in table['controller'].tolist()],
            'tickvals': list(range(len(names))),
            'ticktext': [html.escape(name) for name in names],
        }
    ]
    for name in (*parameters, *metrics):
        dimensions.append({'label': html.escape(name.rpartition(':')[2]), 'values': _finite(table[name])})
    line: dict[str, Any] = {'color': '#1f77b4'}
    if metric:
        title = {'text': html.escape(_label(table, metric))}
        line = {'color': _finite(table[metric]), 'showscale': True, 'colorbar': {'title': title}}
    # Slanted: names of metrics are longer than the distance of the axes.
    trace = {'type': 'parcoords', 'dimensions': dimensions, 'line': line, 'labelangle': -25}
    return {'data': [trace], 'layout': {'height': 480, 'margin': {'t': 140}}}


def _worst(campaign: Campaign, table: Table, metric: str, folder: Path) -> str:
    lines = []
    # File names in parameters may be relative to the working directory of the campaign.
    start = f'cd {shlex.quote(str(Path.cwd()))} && '
    numbers = campaign.worst(table, '', WORST)
    if metric:
        numbers += campaign.worst(table.where(status=FINISHED), metric, WORST)
    for number in numbers:
        run, row = campaign.plan[number], table[number]
        command = run.command(base_file(folder, run.controller), f'runs/{campaign.spec.name}-{run_name(run)}')
        value = [f'{row[metric]:.5g}'] if metric else []
        lines.append(
            [str(number), run.controller, *value, row['status'], row['verdict'], row['reason'], start + command]
        )
    head = ['run', 'controller', *([metric] if metric else []), 'status', 'verdict', 'reason', 'command']
    return _html_table(head, lines, [column for column in range(1, len(head)) if head[column] != metric])
