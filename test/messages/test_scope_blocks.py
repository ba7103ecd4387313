"""The decimation for live viewers keeps every peak, and the blocks have every field of the contract."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.scope_blocks import Block, ScopeMessage, decimated, make_block, read_scope_message
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS, SIGNAL_TOPICS
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.messages.unpacking import signals_of_messages
from hdd_servo_ros.simulation.experiment import Experiment


@given(st.integers(1, 500), st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_no_peak_is_lost(count, bins, seed):
    values = np.column_stack((np.arange(count), np.random.default_rng(seed).normal(size=(count, 3))))
    rows = decimated(values, bins)
    assert len(rows) <= max(2 * bins, count if count < 2 * bins else 0)
    assert np.array_equal(rows.min(axis=0), values.min(axis=0))
    assert np.array_equal(rows.max(axis=0), values.max(axis=0))
    assert np.all(np.diff(rows[:, 0]) >= 0.0)


def test_few_rows_stay_as_they_are():
    values = np.arange(12.0).reshape(6, 2)
    assert decimated(values, 4) is values


@pytest.mark.parametrize('controller', ['adaptive_nn', 'pid'])
def test_a_block_holds_the_signals_of_its_ticks(controller):
    experiment = Experiment(1e-4, controller)
    rows = experiment.run(0, 50)
    vectors, estimates, ticks = VectorCodec('drive'), ArrayCodec(rows.estimate_names), Ticks(1e-4)
    messages = []
    for tick in range(50):
        stamp = ticks.stamp(tick)
        reference, head, control = (
            vectors.pack(stamp, *values[tick]) for values in (rows.reference, rows.head, rows.control)
        )
        ldv = vectors.pack(stamp, *rows.ldv[tick])
        array = estimates.pack(rows['estimates'][tick])
        messages.append((ClockCodec.pack(stamp), reference, head, ldv, control, array))
    signals = signals_of_messages(20, 1e-4, LOOP_TOPICS, messages[20:])
    block = make_block(signals)
    fields = [f'{topic.name}.{name}' for topic in SIGNAL_TOPICS if topic in LOOP_TOPICS for name in topic.field_names]
    assert block.names[: 2 + len(fields)] == ('t', 'error', *fields)
    column = dict(zip(block.names, block.rows.T, strict=True))
    assert np.allclose(column['t'], rows.time[20:], rtol=0.0, atol=1e-12)
    assert np.array_equal(column['error'], rows.head[20:, 0] - rows.reference[20:, 0])
    for name in fields:
        topic, _, field = name.partition('.')
        assert np.array_equal(column[name], getattr(getattr(rows, topic), field)[20:]), name
    for name in rows.estimate_names[1:]:
        assert np.array_equal(column[f'estimates.{name}'], rows.estimates[name][20:])


def block_message(label='um,V,host:1:a', names='t,error', data=(0.0, 1.0, 2.0, 3.0)):
    dimensions = [SimpleNamespace(label=label), SimpleNamespace(label=names)]
    return SimpleNamespace(layout=SimpleNamespace(dim=dimensions), data=data)


def test_what_is_written_is_read_again():
    rows = np.arange(6.0).reshape(2, 3)
    written = ScopeMessage('host:1:a', Units('mm', 'A'), Block(('t', 'error', 'head.position'), rows))
    read = read_scope_message(block_message(*written.labels, rows.ravel()))
    assert (read.run, read.units, read.block.names) == (written.run, written.units, written.block.names)
    assert np.array_equal(read.block.rows, rows)


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        (block_message('um,V'), 'two units and the run'),
        (block_message(names='error,t'), 'start with t, error'),
        (block_message(names='t,error,error'), 'unique'),
        (block_message(names='t,error' + ',x' * 600), 'unique'),
        (block_message(data=()), '0 numbers'),
        (block_message(data=(0.0, 1.0, 2.0)), '3 numbers in 2 columns'),
        (block_message(data=np.zeros(100_000)), '100000 numbers'),
        (block_message(data=(1.0, 0.0, 0.5, 0.0)), 'do not increase'),
        (block_message(data=(np.nan, 0.0)), 'do not increase'),
        (SimpleNamespace(layout=SimpleNamespace(dim=[]), data=()), '0 dimensions'),
    ],
)
def test_what_is_no_block_is_rejected(message, said):
    with pytest.raises(ValueError, match=said):
        read_scope_message(message)
