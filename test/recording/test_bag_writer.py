import os
import signal
from typing import Any

import pytest
import yaml
from rosbags.highlevel import AnyReader

from hdd_servo_ros.messages.cdr import ClockCodec, VectorCodec
from hdd_servo_ros.messages.errors import WriterError
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.recording import writer_process
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.writer_process import BATCH_MESSAGES, WriterProcess

TICKS = Ticks(1e-4)
TOPICS = [('/clock', 'rosgraph_msgs/msg/Clock', 1024), ('/bench1/head', 'geometry_msgs/msg/Vector3Stamped', 7)]
WRITERS = [BagWriter, WriterProcess]
COUNT = BATCH_MESSAGES + 100


def write(writer_class, path, storage='mcap'):
    vector = VectorCodec('drive')
    writer = writer_class(path, storage, TOPICS, {'length_unit': 'um'})
    for tick in range(COUNT):
        stamp = TICKS.stamp(tick)
        messages = (ClockCodec.pack(stamp), vector.pack(stamp, float(tick), 0.0, 0.0))
        writer.write((0, 1), (TICKS.nanoseconds(tick),) * 2, messages)
    writer.close()


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('writer_class', WRITERS)
def test_what_is_written_is_read(tmp_path, writer_class, storage):
    write(writer_class, tmp_path / 'bag', storage)
    with AnyReader([tmp_path / 'bag']) as reader:
        found: list[tuple[str, int, Any]] = [
            (connection.topic, stamp, reader.deserialize(payload, connection.msgtype))
            for connection, stamp, payload in reader.messages()
        ]
    assert len(found) == 2 * COUNT
    assert [message.vector.x for topic, _, message in found if topic == '/bench1/head'] == list(range(COUNT))
    assert [stamp for topic, stamp, _ in found if topic == '/clock'] == [k * 100_000 for k in range(COUNT)]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_ros2_bag_info_reads(tmp_path, storage):
    write(BagWriter, tmp_path / 'bag', storage)
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert content['version'] == 9
    assert content['ros_distro'] == 'jazzy'
    assert content['storage_identifier'] == storage
    assert content['custom_data'].pop('crc32_by_topic', None) is None or storage == 'sqlite3'
    assert content['custom_data'] == {'length_unit': 'um'}
    assert content['message_count'] == 2 * COUNT
    head = content['topics_with_message_count'][1]['topic_metadata']
    assert head['name'] == '/bench1/head'
    # The hash is that of the message definition of Jazzy, as `ros2 topic info --verbose` prints it.
    assert head['type_description_hash'].startswith('RIHS01_')
    (qos,) = head['offered_qos_profiles']
    assert (qos['history'], qos['depth'], qos['reliability'], qos['durability']) == (
        'keep_last',
        7,
        'reliable',
        'volatile',
    )
    bag = (tmp_path / 'bag' / content['relative_file_paths'][0]).read_bytes()
    assert b'jazzy' in bag
    assert b'ros_distro: rosbags' not in bag


def test_type_hashes_are_those_of_rclpy(tmp_path):
    pytest.importorskip('rclpy')
    from geometry_msgs.msg import Vector3Stamped

    write(BagWriter, tmp_path / 'bag')
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    recorded = content['topics_with_message_count'][1]['topic_metadata']['type_description_hash']
    import rclpy
    from rclpy.context import Context

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('hashes', context=context)
    try:
        node.create_publisher(Vector3Stamped, 'head', 1)
        (info,) = node.get_publishers_info_by_topic('head')
        assert recorded == f'RIHS01_{bytes(info.topic_type_hash.value).hex()}'
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_the_other_process_writes_the_same_bytes(tmp_path):
    write(BagWriter, tmp_path / 'here' / 'bag')
    write(WriterProcess, tmp_path / 'there' / 'bag')
    assert (tmp_path / 'here' / 'bag' / 'bag.mcap').read_bytes() == (
        tmp_path / 'there' / 'bag' / 'bag.mcap'
    ).read_bytes()


def test_nothing_is_overwritten(tmp_path):
    write(BagWriter, tmp_path / 'bag')
    with pytest.raises(FileExistsError, match='already exists'):
        BagWriter(tmp_path / 'bag', 'mcap', TOPICS, {})
    with pytest.raises(RuntimeError, match='already exists'):
        WriterProcess(tmp_path / 'bag', 'mcap', TOPICS, {})


@pytest.mark.parametrize('writer_class', WRITERS)
def test_unknown_storage(tmp_path, writer_class):
    with pytest.raises((ValueError, RuntimeError), match="storage: 'tape'; expected one of mcap, sqlite3"):
        writer_class(tmp_path / 'bag', 'tape', TOPICS, {})


def test_a_writer_that_dies_is_an_error_and_no_hang(tmp_path):
    writer = WriterProcess(tmp_path / 'bag', 'mcap', TOPICS, {})
    writer._process.kill()
    writer._process.wait()
    message = ClockCodec.pack(TICKS.stamp(0))
    with pytest.raises(RuntimeError, match='the bag writer ended with -9'):
        writer.write((0,) * BATCH_MESSAGES, (0,) * BATCH_MESSAGES, (message,) * BATCH_MESSAGES)


def test_a_pipe_that_ends_early_leaves_a_closed_bag(tmp_path):
    writer = WriterProcess(tmp_path / 'bag', 'mcap', TOPICS, {})
    for tick in range(COUNT):
        writer.write((0,), (TICKS.nanoseconds(tick),), (ClockCodec.pack(TICKS.stamp(tick)),))
    writer._pipe.close()  # as when the loop's process is killed
    assert writer._process.wait(100.0) == 2
    with AnyReader([tmp_path / 'bag']) as reader:
        assert sum(1 for _ in reader.messages()) == BATCH_MESSAGES


def test_a_writer_that_does_not_start_fails_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(writer_process, 'OPEN_TIMEOUT', 0.5)
    process = writer_process.launch_writer()
    os.kill(process.pid, signal.SIGSTOP)
    with pytest.raises(WriterError, match=r'the bag writer did not open the bag within 0.5 s'):
        WriterProcess(tmp_path / 'bag', 'mcap', [('/clock', 'rosgraph_msgs/msg/Clock', 10)], {}, process=process)
    assert process.wait(100.0) == -signal.SIGKILL
