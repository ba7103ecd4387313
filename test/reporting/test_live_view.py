"""The live view draws the panels of a run from decimated blocks."""

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from hdd_servo_ros.messages.scope_blocks import Block, make_block
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.reporting.live_view import BlockSignals, LiveView
from hdd_servo_ros.reporting.loop_panels import loop_panels
from hdd_servo_ros.reporting.panel import COLORS

T = 1e-4


def signals(first, count):
    """Return a sine that the head follows 0.1 ms late."""
    time = np.arange(first, first + count) * T
    x_d, x = (2.0 * np.sin(2.0 * np.pi * 100.0 * (time - delay)) for delay in (0.0, T))
    u = 0.1 * np.cos(2.0 * np.pi * 100.0 * time)
    zero = np.zeros(count)
    arrays = {
        'reference': np.column_stack((x_d, zero, zero)),
        'head': np.column_stack((x, zero, zero)),
        'control': np.column_stack((u, 2.0 * u, 0.5 * u)),
        'estimates': np.column_stack((time, time, 3.0 + zero, 1.0 - time)),
    }
    return SignalRows(first, T, arrays, ('t', 'r', 'fixed', 'm_hat'))


def block(first, count):
    return make_block(signals(first, count))


def labels(figure):
    return {axis.get_ylabel(): {line.get_label(): line for line in axis.lines} for axis in figure.axes}


def test_the_error_is_the_column_of_the_blocks():
    """The difference of two extremes would be several times too large."""
    figure = Figure()
    view = LiveView(figure, 1.0)
    assert view.is_empty
    view.draw()
    whole = signals(0, 20_000)
    view.add(make_block(whole), Units())
    view.draw()
    found = labels(figure)
    assert list(found) == ['position [µm]', 'error [nm]', 'control [V]', 'normalized by the peak']
    error = found['error [nm]']['head - reference'].get_ydata()
    late = whole.error[whole.time >= whole.time[-1] - 1.0]
    assert np.abs(error).max() == 1e3 * np.abs(late).max()
    assert list(found['normalized by the peak']) == ['m_hat (largest 1)']
    color = found['control [V]']['feedback part'].get_color()
    assert matplotlib.colors.same_color(color, COLORS[3])


def test_what_is_older_than_the_window_is_dropped():
    figure = Figure()
    view = LiveView(figure, 0.5)
    for first in range(0, 20_000, 1000):
        view.add(block(first, 1000), Units('m', 'N'))
    view.draw()
    found = labels(figure)
    assert list(found)[:3] == ['position [m]', 'error [m]', 'control [N]']
    time = found['position [m]']['head'].get_xdata()
    assert time[-1] == 19_999 * T
    assert time[-1] - 0.5 <= time[0] < time[-1] - 0.49


def test_a_controller_with_other_estimates_begins_anew():
    view = LiveView(Figure(), 10.0)
    view.add(block(0, 100), Units())
    other = block(100, 100)
    names = tuple(name for name in other.names if not name.startswith('estimates.'))
    view.add(Block(names, other.rows[:, : len(names)]), Units())
    view.draw()
    view.add(block(200, 100), Units())
    view.draw()


def test_the_panels_are_those_of_a_run():
    """Undecimated, the blocks give the panels of the same signals in memory."""
    in_memory, undecimated = signals(0, 300), block(0, 300)
    live = BlockSignals(undecimated.names, undecimated.rows, Units())
    for left, right in zip(loop_panels(live, follows=True), loop_panels(in_memory, follows=True), strict=True):
        assert (left.title, left.y_label) == (right.title, right.y_label)
        for one, other in zip(left.traces, right.traces, strict=True):
            assert (one.name, one.color, one.wide) == (other.name, other.color, other.wide)
            np.testing.assert_array_equal(one.y, other.y)
            np.testing.assert_allclose(one.x, other.x, rtol=0.0, atol=1e-12)


def test_the_topics_of_blocks_are_read_as_those_of_a_run():
    in_memory, undecimated = signals(0, 300), block(0, 300)
    live = BlockSignals(undecimated.names, undecimated.rows, Units())
    for topic in ('reference', 'head', 'control'):
        np.testing.assert_array_equal(live[topic], in_memory[topic])
    np.testing.assert_array_equal(live.control.before_saturation, in_memory.control.before_saturation)
    np.testing.assert_array_equal(live.estimates['m_hat'], in_memory.estimates['m_hat'])
    assert 'ldv' not in live
    with pytest.raises(KeyError, match='ldv'):
        live['ldv']


def test_seeks_show_target_mode_and_two_scales():
    """From blocks of a controller that gives its mode and its target."""
    count = 2000
    time = T * np.arange(count)
    target = np.where(time < 0.1, 0.0, 10.0)
    head = np.where(time < 0.101, 0.0, 10.02)
    zero = np.zeros(count)
    mode = np.where((time >= 0.1) & (time < 0.101), 1.0, 0.0) + np.where((time >= 0.101) & (time < 0.103), 2.0, 0.0)
    arrays = {
        'reference': np.column_stack((target, zero, zero)),
        'head': np.column_stack((head, zero, zero)),
        'control': np.column_stack((zero, zero, zero)),
        'estimates': np.column_stack((time, mode, target)),
    }
    figure = Figure()
    view = LiveView(figure, 1.0)
    view.add(make_block(SignalRows(0, T, arrays, ('t', 'seek_mode', 'seek_target'))), Units())
    view.draw()
    tracking, coarse, fine, _ = figure.axes
    assert [line.get_label() for line in tracking.lines] == ['target', 'head']
    assert (coarse.get_ylim(), fine.get_ylim()) == ((-1000.0, 1000.0), (-100.0, 100.0))
    (error,) = fine.lines
    assert np.asarray(error.get_ydata())[-1] == pytest.approx(20.0)
    assert [shade.get_label() for shade in fine.collections] == ['mode: seek', 'mode: settle']
    corners = [np.asarray(shade.get_paths()[0].vertices)[:, 0] for shade in fine.collections]
    # To a bin of the block.
    assert [x.min() for x in corners] == pytest.approx([0.1, 0.101], abs=1e-3)
    assert [x.max() for x in corners] == pytest.approx([0.101, 0.103], abs=1e-3)
