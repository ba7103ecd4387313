"""Bags of another recorder: the stamps inside decide what a tick is, and a bag of two runs is rejected."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import NANOSECONDS, Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_columns import BagError
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.reporting.evaluation import transient_end
from hdd_servo_ros.tools.report import main as report

TYPES = get_typestore(Stores.ROS2_JAZZY)
T = 100_000
WALL = 1_700_000_000 * NANOSECONDS
"""A time of a wall clock, which T divides [ns]."""


def write(path, ticks, *, origin=0, received=None, storage=StoragePlugin.MCAP, amplitude=1.0, change=None):
    """
    Write a bag of ticks.

    Parameters
    ----------
    path, storage
        The bag.
    ticks
        The ticks, in the order of recording.
    origin
        Time of tick 0 in the stamps [ns].
    received
        Receive time of each tick [ns], for the topics after /clock that much later; None for a wall clock.
    amplitude
        Of the head.
    change
        Changes a message: takes topic, number and payload.
    """
    times = [WALL + 123_457 * number for number in range(len(ticks))] if received is None else received
    vector, array = VectorCodec('drive'), ArrayCodec(['t', 'r'])
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = [
            writer.add_connection(f'/{topic.name}', topic.type_name, typestore=TYPES) for topic in LOOP_TOPICS
        ]
        for number, (tick, time) in enumerate(zip(ticks, times, strict=True)):
            stamp = stamp_of(origin + tick * T)
            x = amplitude * np.sin(0.1 * tick)
            for topic, connection in zip(LOOP_TOPICS, connections, strict=True):
                payload = vector.pack(stamp, x, 0.0, 0.0)
                if topic.name == 'clock':
                    payload = ClockCodec.pack(stamp)
                elif topic.name == 'estimates':
                    payload = array.pack([(origin + tick * T) / NANOSECONDS, 0.0])
                if change is not None:
                    payload = change(topic.name, number, payload)
                writer.write(connection, time, payload)
    return path


def stamp_of(nanoseconds):
    return Ticks(1e-9).stamp(nanoseconds)


@pytest.mark.parametrize(
    ('ticks', 'message'),
    [
        ([*range(100), *range(100)], '/clock goes back from tick 99 to 0 at message 100'),
        ([*range(100), *range(40, 80)], '/clock goes back from tick 99 to 40 at message 100'),
        ([*range(50), 49, *range(50, 60)], '/clock has tick 49 twice at message 50'),
        ([0, 2, 1, 3], '/clock goes back from tick 2 to 1 at message 2'),
    ],
)
@pytest.mark.parametrize('origin', [0, WALL])
@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_stamps_that_go_back_or_repeat_are_rejected(tmp_path, capsys, ticks, message, origin, storage):
    bag = write(tmp_path / 'bag', ticks, origin=origin, storage=storage)
    with pytest.raises(
        BagError, match='the bag contains more than one run, or a topic with two publishers'
    ) as rejected:
        Run.open(bag).head  # noqa: B018
    assert message in str(rejected.value)
    assert report([str(bag), '--output', str(tmp_path / 'out')]) == 3
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_two_runs_received_in_simulated_time_are_rejected(tmp_path):
    """Sorted by receive time they lie between each other."""
    ticks = [*range(60), *range(60)]
    bag = write(tmp_path / 'bag', ticks, received=[T * tick for tick in ticks])
    with pytest.raises(BagError, match='more than one run'):
        Run.open(bag).head  # noqa: B018


@pytest.mark.parametrize('late', [0, 1, 3])
def test_receive_times_in_simulated_time(tmp_path, late):
    """As `ros2 bag record` with use_sim_time: the time of the last /clock that it has received."""
    received = [T * max(tick - late, 0) for tick in range(400)]
    run = Run.open(write(tmp_path / 'bag', range(400), received=received))
    assert run.ticks.tolist() == list(range(400))
    np.testing.assert_array_equal(run.position, np.sin(0.1 * np.arange(400)))


def test_receive_times_of_which_only_those_of_the_clock_are_the_stamps(tmp_path):
    shifted = tmp_path / 'bag'
    vector = VectorCodec('drive')
    with Writer(shifted, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        clock = writer.add_connection('/clock', 'rosgraph_msgs/msg/Clock', typestore=TYPES)
        head = writer.add_connection('/head', 'geometry_msgs/msg/Vector3Stamped', typestore=TYPES)
        for tick in range(100):
            writer.write(clock, tick * T, ClockCodec.pack(stamp_of(tick * T)))
            if tick:
                writer.write(head, tick * T, vector.pack(stamp_of((tick - 1) * T), tick - 1.0, 0.0, 0.0))
        writer.write(head, 100 * T, vector.pack(stamp_of(99 * T), 99.0, 0.0, 0.0))
    run = Run.open(shifted)
    assert run.position.tolist() == [float(tick) for tick in range(100)]


@pytest.mark.parametrize('origin', [WALL, WALL + 7])
@pytest.mark.parametrize('first', [0, 500])
def test_stamps_in_wall_time_count_from_the_first(tmp_path, origin, first):
    run = Run.open(write(tmp_path / 'bag', range(first, first + 400), origin=origin))
    assert run.ticks.tolist() == list(range(400))
    assert run.time[-1] == pytest.approx(399e-4, rel=1e-12)
    assert transient_end(run) == pytest.approx(0.5 * 399e-4)
    assert run.since(transient_end(run)).start == 200
    np.testing.assert_array_equal(run.position, np.sin(0.1 * np.arange(first, first + 400)))
    assert len(run['estimates']) == 400
    assert report([str(run.path), '--output', str(tmp_path / 'out')]) == 0


def test_stamps_in_wall_time_between_ticks_are_rejected(tmp_path):
    def jitter(topic, number, payload):
        if topic != 'ldv' or number != 7:
            return payload
        return payload[:4] + stamp_of(WALL + number * T + 1234) + payload[12:]

    bag = write(tmp_path / 'bag', range(20), origin=WALL, change=jitter)
    with pytest.raises(BagError, match=r'/ldv: message 7 has stamp \d+ ns, 701234 ns after the first, which does not'):
        Run.open(bag).ldv  # noqa: B018


def test_negative_stamps_are_rejected_by_their_number(tmp_path, capsys):
    bag = write(tmp_path / 'bag', range(-5, 20))
    assert report([str(bag), '--output', str(tmp_path / 'out')]) == 3
    error = capsys.readouterr().err
    assert '/clock: message 0 has stamp -500000 ns, before time 0' in error
    assert 'None' not in error


def longer(topic, number, payload):
    return payload + bytes(8) if topic == 'head' and number == 3 else payload


def shorter(topic, number, payload):
    return payload[:-8] if topic == 'head' and number == 3 else payload


def big_endian(topic, number, payload):
    return b'\x00\x00' + payload[2:] if topic == 'head' and number == 3 else payload


def other_encoding(topic, number, payload):
    return b'\x00\x07' + payload[2:] if topic == 'head' and number == 3 else payload


def renamed(topic, number, payload):
    return payload.replace(b't,r', b't,q') if topic == 'estimates' and number == 3 else payload


def no_names(topic, number, payload):
    return payload[:4] + bytes(8) + payload[-16:] if topic == 'estimates' and number == 3 else payload


def tiny(topic, number, payload):
    return payload[:3] if topic == 'control' and number == 3 else payload


def longer_frame(topic, number, payload):
    return payload[:12] + b'\xff\x00' + payload[14:] if topic == 'head' and number == 3 else payload


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (longer, '/head: message 3 has 60 bytes; expected 52 for a geometry_msgs/msg/Vector3Stamped'),
        (shorter, '/head: message 3 has 44 bytes'),
        (big_endian, '/head: message 3 is big-endian; expected little-endian CDR'),
        (other_encoding, '/head: message 3 is of encapsulation 0x0007'),
        (renamed, '/estimates: message 3 has another layout than the first'),
        (no_names, '/estimates: '),
        (tiny, '/control: message 3 has 3 bytes, too few for CDR'),
        (longer_frame, '/head: message 3 has 52 bytes'),
    ],
)
@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_message_that_is_laid_out_in_another_way_is_rejected(tmp_path, capsys, change, message, storage):
    bag = write(tmp_path / 'bag', range(20), change=change, storage=storage)
    assert report([str(bag), '--output', str(tmp_path / 'out')]) == 3
    assert compare_bags([str(bag), str(bag)]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all(message in line for line in lines)


def test_every_message_big_endian(tmp_path):
    bag = write(tmp_path / 'bag', range(20), change=lambda topic, number, payload: b'\x00\x00' + payload[2:])
    with pytest.raises(BagError, match='message 0 is big-endian'):
        Run.open(bag).head  # noqa: B018


def test_wall_stamps_may_equal_the_receive_times(tmp_path, capsys):
    """As a node records what it stamps itself; tick 0 is the first stamp then, too."""
    times = [WALL + tick * T for tick in range(400)]
    run = Run.open(write(tmp_path / 'bag', range(400), origin=WALL, received=times))
    assert run.sample_time == 1e-4
    assert np.array_equal(run.ticks, np.arange(400))
    assert np.allclose(run['head'][:, 0], np.sin(0.1 * np.arange(400)))
    run.verify()
    assert report([str(tmp_path / 'bag')]) == 0

    def change(topic, number, payload):
        return (
            VectorCodec('drive').pack(stamp_of(WALL + 7 * T), 9.0, 0.0, 0.0)
            if (topic, number) == ('ldv', 7)
            else payload
        )

    write(tmp_path / 'other', range(400), origin=WALL, received=times, change=change)
    capsys.readouterr()
    assert compare_bags([str(tmp_path / 'bag'), str(tmp_path / 'other')]) == 1
    assert 'ldv differs first at tick 7' in capsys.readouterr().out


@pytest.mark.parametrize('is_strict', [True, False])
def test_arrays_may_keep_the_time_of_the_run_where_stamps_are_of_a_wall_clock(tmp_path, is_strict):
    """Who stamps messages anew changes their headers, and an array has none."""
    array = ArrayCodec(['t', 'r'])

    def change(topic, number, payload):
        return array.pack([number * T / NANOSECONDS, 0.0]) if topic == 'estimates' else payload

    times = [WALL + tick * T for tick in range(400)] if is_strict else None
    run = Run.open(write(tmp_path / 'bag', range(400), origin=WALL, received=times, change=change))
    assert np.array_equal(run.ticks, np.arange(400))
    assert np.allclose(run['estimates'][:, 0], run.time)
    assert report([str(tmp_path / 'bag')]) == 0
