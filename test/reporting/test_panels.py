"""Each field of a panel and of a line changes the picture and the page alike."""

import base64
import dataclasses

import matplotlib.image
import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from hdd_servo_ros.reporting.page import _figures
from hdd_servo_ros.reporting.panel import CloseUp, Panel, Shade, Trace, fitted_range
from hdd_servo_ros.reporting.plot import Stack, draw_panel, write_plot

X = np.linspace(0.1, 1.0, 200)
SMALL = Trace('small', X, 1.0 + 0.5 * np.sin(40.0 * X), '#ff0000')
LARGE = Trace('large', X, 5.0 + 4.0 * np.sin(50.0 * X), '#0000ff')
PLAIN = Panel('name', 'Title', 'x [s]', 'y [V]', (SMALL, LARGE))


def changed(trace=None, **fields):
    """Return the plain panel with other fields, of itself or of its first line."""
    traces = (dataclasses.replace(SMALL, **trace), LARGE) if trace else PLAIN.traces
    return dataclasses.replace(PLAIN, traces=traces, **fields)


CHANGES = {
    'title': changed(title='Another'),
    'x_label': changed(x_label='time'),
    'y_label': changed(y_label='volts'),
    'over_time': changed(over_time=True),
    'logarithmic': changed(logarithmic=True),
    'logarithmic_x': changed(logarithmic_x=True),
    'largest_first': changed(largest_first=True),
    'y_range': changed(y_range=(0.5, 20.0)),
    'close_up': changed(close_up=CloseUp(0.4, 0.5, 'part')),
    'shades': changed(shades=(Shade('shaded', np.array([[0.2, 0.3], [0.45, 0.8]]), '#00ff00'),)),
    'traces': changed(trace={'y': SMALL.y + 0.3}),
    'categories': changed(categories=('first', 'second')),
}
TRACE_CHANGES = {
    'name': changed(trace={'name': 'other'}),
    'x': changed(trace={'x': X + 0.1}),
    'y': changed(trace={'y': SMALL.y + 0.3}),
    'color': changed(trace={'color': '#00ff00'}),
    'wide': changed(trace={'wide': True}),
    'marked': changed(trace={'marked': True}),
    'barred': changed(trace={'barred': True}),
    'clipped': dataclasses.replace(PLAIN, traces=(SMALL, dataclasses.replace(LARGE, clipped=True))),
}


def drawn(panel, path):
    write_plot([panel], '', path)
    return matplotlib.image.imread(path)


def figure(panel):
    (found,) = _figures([panel], 1e-4)
    go.Figure(decoded(found))  # rejects a property that plotly does not know
    return found


def decoded(coded):
    lines = []
    for line in coded['data']:
        values = {}
        for axis in 'xy':
            kind = '<i4' if 'i4' in line[axis] else '<f4'
            values[axis] = np.frombuffer(base64.b64decode(line[axis][kind[1:]]), kind) * line[axis].get('scale', 1.0)
        lines.append({**line, **values})
    return {**coded, 'data': lines}


def test_every_field_is_covered():
    assert {field.name for field in dataclasses.fields(Panel)} - {'name'} == CHANGES.keys()
    assert {field.name for field in dataclasses.fields(Trace)} == TRACE_CHANGES.keys()


@pytest.mark.parametrize('field', [*CHANGES, *(f'traces.{name}' for name in TRACE_CHANGES)])
def test_each_field_changes_picture_and_page(tmp_path, field):
    panel = TRACE_CHANGES[field.removeprefix('traces.')] if field.startswith('traces.') else CHANGES[field]
    before, after = drawn(PLAIN, tmp_path / 'before.png'), drawn(panel, tmp_path / 'after.png')
    assert before.shape != after.shape or not np.array_equal(before, after)
    assert figure(PLAIN) != figure(panel)


def test_the_page_draws_what_each_field_asks_for():
    plain = figure(PLAIN)['layout']
    assert 'type' not in plain['xaxis']
    assert 'range' not in plain['yaxis']
    layout = figure(CHANGES['logarithmic'])['layout']
    assert (layout['xaxis']['type'], layout['yaxis']['type']) == ('log', 'log')
    layout = figure(CHANGES['logarithmic_x'])['layout']
    assert layout['xaxis']['type'] == 'log'
    assert 'type' not in layout['yaxis']
    # The same range on both kinds of axis.
    assert figure(changed(y_range=(0.1, 100.0)))['layout']['yaxis']['range'] == [0.1, 100.0]
    assert figure(changed(y_range=(0.1, 100.0), logarithmic=True))['layout']['yaxis']['range'] == [-1.0, 2.0]
    assert [line['name'] for line in figure(CHANGES['largest_first'])['data']] == ['large', 'small']
    assert [line['legendrank'] for line in figure(CHANGES['largest_first'])['data']] == [2, 1]
    marked, joined = figure(TRACE_CHANGES['marked'])['data']
    assert (marked['mode'], joined['mode']) == ('markers', 'lines')
    bars, _ = figure(TRACE_CHANGES['barred'])['data']
    assert bars['type'] == 'bar'
    named = figure(CHANGES['categories'])
    assert named['layout']['xaxis']['ticktext'] == ['first', 'second']
    assert named['layout']['xaxis']['tickvals'] == [0, 1]
    assert not any(line['showlegend'] for line in named['data'])
    low, high = figure(TRACE_CHANGES['clipped'])['layout']['yaxis']['range']
    assert 0.4 < low < 0.5
    assert 1.5 < high < 1.6


def pixels(color, path):
    """Return the columns of a picture in which a color is."""
    image = matplotlib.image.imread(path)[:, :, :3]
    return np.flatnonzero((np.abs(image - np.array(color)) < 0.02).all(axis=2).any(axis=0))


def test_shades_are_behind_their_parts_of_the_axis(tmp_path):
    shades = CHANGES['shades'].shades
    panel = changed(shades=shades, close_up=CloseUp(0.4, 0.5, 'part'))
    found = figure(panel)['layout']['shapes']
    assert [(shape['x0'], shape['x1'], shape['xref']) for shape in found] == [
        (0.2, 0.3, 'x'),
        (0.45, 0.8, 'x'),
        (0.45, 0.5, 'x2'),
    ]
    assert [shape['showlegend'] for shape in found] == [True, False, False]
    plain = dataclasses.replace(PLAIN, over_time=True, traces=(SMALL,))
    write_plot([dataclasses.replace(plain, shades=shades)], '', tmp_path / 'shaded.png')
    # Green over white, half transparent; the legend shows it as well.
    found = pixels((0.5, 1.0, 0.5), tmp_path / 'shaded.png')
    assert len(found) > 100
    write_plot([plain], '', tmp_path / 'plain.png')
    assert len(pixels((0.5, 1.0, 0.5), tmp_path / 'plain.png')) == 0


def test_shades_do_not_scale_the_axes(tmp_path):
    wide = Shade('shaded', np.array([[-5.0, 8.0]]), '#00ff00')
    limits = []
    for shades in ((), (wide,)):
        axis = Figure().add_subplot()
        draw_panel(axis, changed(shades=shades))
        limits.append((axis.get_xlim(), axis.get_ylim()))
    assert limits[0] == limits[1]


def test_too_many_shades_are_left_out_of_the_page_but_not_of_its_close_up():
    starts = np.linspace(0.1, 0.9, 2000)
    many = Shade('many', np.column_stack([starts, starts + 1e-4]), '#00ff00')
    found = figure(changed(shades=(many,), close_up=CloseUp(0.4, 0.5, 'part')))['layout']['shapes']
    assert {shape['xref'] for shape in found} == {'x2'}
    assert 200 < len(found) < 300


def test_marked_points_are_not_joined():
    axis = Figure().add_subplot()
    draw_panel(axis, TRACE_CHANGES['marked'])
    assert [line.get_linestyle() for line in axis.lines] == ['None', '-']


def test_a_close_up_is_drawn_next_to_the_whole():
    found = decoded(figure(CHANGES['close_up']))
    assert [line['showlegend'] for line in found['data']] == [True, True, False, False]
    assert found['layout']['xaxis2']['range'] == [0.4, 0.5]
    assert found['layout']['xaxis']['domain'][1] < found['layout']['xaxis2']['domain'][0]
    assert [title['text'] for title in found['layout']['annotations']] == ['<b>Title</b>', '<b>part</b>']
    for line in found['data'][2:]:
        assert line['x'].min() >= np.float32(0.4)
        assert line['x'].max() <= np.float32(0.5)
    whole, part = found['data'][0], found['data'][2]
    assert whole['legendgroup'] == part['legendgroup']


def test_diagrams_over_time_share_their_axis_and_so_do_their_close_ups():
    panels = [CHANGES['over_time'], changed(over_time=True, close_up=CloseUp(0.4, 0.5, 'part'))]
    (found,) = _figures([*panels, panels[1]], 1e-4)
    layout = found['layout']
    assert [layout[f'xaxis{number}'].get('matches') for number in ('', '2', '3', '5', '6')] == [
        *(None, 'x', 'x'),
        *(None, 'x5'),
    ]
    assert 'xaxis4' not in layout


def test_a_logarithmic_axis_without_positive_values_is_linear(tmp_path):
    panel = Panel('name', '', '', '', (Trace('zero', X, 0.0 * X, '#ff0000'),), logarithmic=True)
    drawn(panel, tmp_path / 'zero.png')
    assert 'type' not in figure(panel)['layout']['yaxis']
    with pytest.raises(ValueError, match='a logarithmic axis cannot start at 0'):
        changed(logarithmic=True, y_range=(0.0, 1.0))


@settings(max_examples=30)
@given(
    st.lists(st.floats(-1e9, 1e9, allow_subnormal=False), min_size=1, max_size=5),
    st.sampled_from([False, True]),
)
def test_a_fitted_range_holds_all_values(values, logarithmic):
    found = fitted_range([np.array(values), np.array([np.nan, np.inf])], logarithmic=logarithmic)
    inside = [value for value in values if value > 0.0 or not logarithmic]
    assert (found is None) == (not inside)
    if inside:
        assert found is not None
        assert found[0] < min(inside)
        assert found[1] > max(inside)


def test_a_stack_is_drawn_again():
    figure_ = Figure()
    stack = Stack(figure_)
    panel = CHANGES['over_time']
    stack.draw([panel, panel])
    axes = list(figure_.axes)
    stack.draw([panel, panel])
    assert figure_.axes == axes
    assert [axis.get_xlabel() for axis in axes] == ['', 'x [s]']
    stack.draw([panel])
    assert len(figure_.axes) == 1
    assert len(figure_.axes[0].lines) == 2
