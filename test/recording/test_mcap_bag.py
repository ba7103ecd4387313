"""Bags that are written in bulk, against those of `rosbags`, by two readers that know nothing of this package."""

import io
import itertools
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.recording import mcap_writer
from hdd_servo_ros.recording.bag_columns import Bag, BagError
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.recording.salvage import salvage

# It has no rosdep key, so that a workspace of ROS may be without; `make test` installs it.
data_stream, reader, records, stream_reader = (
    pytest.importorskip(f'mcap.{name}') for name in ('data_stream', 'reader', 'records', 'stream_reader')
)
NonSeekingReader, SeekingReader = reader.NonSeekingReader, reader.SeekingReader
StreamReader = stream_reader.StreamReader

TOPICS = [
    ('/clock', 'rosgraph_msgs/msg/Clock', 1024),
    ('/bench1/head', 'geometry_msgs/msg/Vector3Stamped', 7),
    ('/bench1/ldv', 'geometry_msgs/msg/Vector3Stamped', 7),
    ('/parameter_events', 'rcl_interfaces/msg/ParameterEvent', 1000),
]
NAMES = [name for name, _, _ in TOPICS]
METADATA = {'length_unit': 'um', 'frame_id': "a drive's name: \N{GREEK SMALL LETTER ALPHA}"}
FOREVER = QosTime(9223372036, 854775807)
PROPERTIES = settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

TYPES = get_typestore(Stores.ROS2_JAZZY)

Message = tuple[int, int, bytes]
"""Index of the topic, time [ns] and payload."""


class Ticks:
    """Messages of ticks whose bytes all come from one array."""

    def __init__(self, times: list[int], sizes: list[int], seed: int) -> None:
        self.times = np.array(times, dtype=np.int64)
        self.templates = [bytes([0xAA]) * size for size in sizes]
        bytes_of = np.random.default_rng(seed)
        self.rows = [bytes_of.integers(0, 256, (len(times), size), dtype=np.uint8) for size in sizes]

    def fill(self, ticks, payloads):
        for rows, part in zip(self.rows, payloads, strict=True):
            # The first byte stays as it is in the template.
            part[:, 1:] = rows[ticks, 1:]

    def messages(self, topics) -> Iterator[Message]:
        for row, time in enumerate(self.times.tolist()):
            for topic, template, rows in zip(topics, self.templates, self.rows, strict=True):
                yield topic, time, template[:1] + rows[row].tobytes()[1:]


TIMES = st.integers(0, 2**63 - 1)
TICKS = st.builds(
    lambda start, count, topics, size, seed: (
        topics,
        Ticks([start + 100_000 * k for k in range(count)], [size + 8 * topic for topic in topics], seed),
    ),
    st.integers(0, 10**12),
    st.integers(0, 60),
    st.permutations(range(4)).flatmap(lambda order: st.integers(1, 4).map(lambda count: order[:count])),
    st.integers(1, 90),
    st.integers(0, 1000),
)
SINGLE = st.lists(st.tuples(st.integers(0, 3), TIMES, st.binary(max_size=120)), max_size=20)
LARGE = st.builds(lambda size, time: [(3, time, bytes(range(256)) * size)], st.integers(0, 40), TIMES)
PARTS = st.lists(st.one_of(TICKS, SINGLE, LARGE), max_size=6)
"""What is written: messages of ticks, or a list of messages of any kind."""


OPTIONS = st.sampled_from(
    [
        BagOptions(),
        BagOptions(compression='zstd'),
        BagOptions(max_bag_size=6000),
        BagOptions(max_bag_duration=1e-3),
        BagOptions(compression='zstd', max_bag_size=10_000, max_bag_duration=2e-3),
    ]
)


def write(path: Path, parts, options=BagOptions()) -> list[Message]:  # noqa: B008 - a frozen value
    """Write a bag; return its messages one by one."""
    writer = BagWriter(path, 'mcap', TOPICS, METADATA, options)
    written: list[Message] = []
    for part in parts:
        if isinstance(part, tuple):
            topics, ticks = part
            writer.write_ticks(topics, ticks)
            written += ticks.messages(topics)
        else:
            columns = zip(*part, strict=True) if part else ((), (), ())
            writer.write(*columns)
            written += part
    writer.close()
    return written


def write_by_rosbags(path: Path, messages: list[Message]) -> None:
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    for key, text in METADATA.items():
        writer.set_custom_data(key, text)
    with writer:
        connections = [
            writer.add_connection(name, kind, typestore=TYPES, offered_qos_profiles=[qos(depth)])
            for name, kind, depth in TOPICS
        ]
        for topic, time, payload in messages:
            writer.write(connections[topic], time, payload)


def qos(depth: int) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        FOREVER,
        FOREVER,
        QosLiveliness.AUTOMATIC,
        FOREVER,
        False,
    )


def read_by_rosbags(path: Path) -> tuple[list[Any], list[Message]]:
    with Reader(path) as reader:
        connections = [connection._replace(owner=None) for connection in reader.connections]
        messages = [(NAMES.index(found.topic), time, bytes(data)) for found, time, data in reader.messages()]
    return connections, messages


def fresh(tmp_path: Path) -> Path:
    """Return a folder of its own for each example of a property."""
    return next(path for n in itertools.count() if not (path := tmp_path / str(n)).exists())


@pytest.fixture
def small_chunks(monkeypatch):
    """Chunks of a few messages, so that each example has many and every boundary is met."""
    monkeypatch.setattr(mcap_writer, 'CHUNK_SIZE', 2000)


@PROPERTIES
@given(parts=PARTS)
def test_rosbags_reads_what_rosbags_would_have_written(tmp_path, small_chunks, parts):
    base = fresh(tmp_path)
    messages = write(base / 'ours' / 'bag', parts)
    write_by_rosbags(base / 'theirs' / 'bag', messages)
    ours, theirs = (read_by_rosbags(base / side / 'bag') for side in ('ours', 'theirs'))
    assert ours == theirs
    # In the order of the times, and at the same time as they were written.
    assert ours[1] == sorted(messages, key=lambda message: message[1])
    metadata = [yaml.safe_load((base / side / 'bag' / 'metadata.yaml').read_text()) for side in ('ours', 'theirs')]
    metadata[1]['rosbag2_bagfile_information']['ros_distro'] = 'jazzy'
    assert metadata[0] == metadata[1]


@PROPERTIES
@given(parts=PARTS)
def test_the_library_of_mcap_reads_it_strictly(tmp_path, small_chunks, parts):
    base = fresh(tmp_path)
    messages = write(base / 'ours' / 'bag', parts)
    write_by_rosbags(base / 'theirs' / 'bag', messages)
    content, theirs = ((base / side / 'bag' / 'bag.mcap').read_bytes() for side in ('ours', 'theirs'))

    def found(reader, **options):
        return [
            (NAMES.index(channel.topic), message.log_time, message.data)
            for _, channel, message in reader.iter_messages(**options)
            if message.publish_time == message.log_time
        ]

    indexed = SeekingReader(io.BytesIO(content), validate_crcs=True)
    assert found(indexed) == sorted(messages, key=lambda message: message[1])
    assert found(indexed, topics=[NAMES[1]]) == sorted(
        (message for message in messages if message[0] == 1), key=lambda message: message[1]
    )
    # From the start, with the checksums of the chunks and of the data section; in the file's order.
    assert found(NonSeekingReader(io.BytesIO(content), validate_crcs=True), log_time_order=False) == messages
    ours, others = indexed.get_summary(), SeekingReader(io.BytesIO(theirs)).get_summary()
    assert ours is not None
    assert others is not None
    assert ours.schemas == others.schemas
    assert ours.channels.keys() == others.channels.keys()
    for number, channel in ours.channels.items():
        other = others.channels[number]
        assert [yaml.safe_load(text) for text in channel.metadata.values()] == [
            yaml.safe_load(text) for text in other.metadata.values()
        ]
        channel.metadata = other.metadata
        assert channel == other
    assert without_chunks(ours.statistics) == without_chunks(others.statistics)
    (ours_metadata,) = indexed.iter_metadata()
    assert ours_metadata.name == 'rosbag2'
    information = yaml.safe_load(ours_metadata.metadata['serialized_metadata'])
    assert information['message_count'] == len(messages)
    check_records(content, messages)


def without_chunks(statistics):
    """Return statistics without what differs by right: the number of chunks, and times where there are none."""
    assert statistics is not None
    statistics.chunk_count = 0
    if not statistics.message_count:
        statistics.message_start_time = statistics.message_end_time = 0
    return statistics


def check_records(content: bytes, messages: list[Message]) -> None:
    """Check every index of a file against the bytes that it points to, and its checksums."""
    chunks = []
    for record in StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True).records:
        if isinstance(record, records.DataEnd):
            assert record.data_section_crc != 0
        elif isinstance(record, records.ChunkIndex):
            chunks.append(record)
        elif isinstance(record, records.Footer):
            footer = record
    assert zlib.crc32(content[footer.summary_start : -12]) == footer.summary_crc
    count = 0
    for chunk in chunks:
        times = []
        head = struct.unpack_from('<BQQQQI', content, chunk.chunk_start_offset)
        assert head[0] == 6
        assert head[1] + 9 == chunk.chunk_length
        data = content[chunk.chunk_start_offset + 49 : chunk.chunk_start_offset + chunk.chunk_length]
        assert zlib.crc32(data) == head[5] != 0
        for number, offset in chunk.message_index_offsets.items():
            (size,) = struct.unpack_from('<Q', content, offset + 1)
            index = records.MessageIndex.read(
                data_stream.ReadDataStream(io.BytesIO(content[offset + 9 : offset + 9 + size]))
            )
            assert (content[offset], index.channel_id) == (7, number)
            for time, offset in index.records:
                opcode, _, channel, sequence, log_time = struct.unpack_from('<BQHIQ', data, offset)
                assert (opcode, channel, sequence, log_time) == (5, number, 0, time)
                times.append(time)
        count += len(times)
        assert (chunk.message_start_time, chunk.message_end_time) == (min(times, default=0), max(times, default=0))
    assert count == len(messages)


@PROPERTIES
@given(parts=PARTS, cut=st.floats(0.0, 1.0))
@example(parts=[], cut=1.0)
def test_cut_off_anywhere(tmp_path, small_chunks, parts, cut):
    base = fresh(tmp_path)
    messages = write(base / 'bag', parts)
    path = base / 'bag' / 'bag.mcap'
    content = path.read_bytes()
    length = int(cut * len(content))
    path.write_bytes(content[:length])
    found = salvage(path)
    # Independently: the file holds the messages one after the other, and those that end before the cut are complete.
    ends = list(message_ends(content))
    assert len(ends) == len(messages)
    complete = sum(end <= length for end in ends)
    assert [(NAMES.index(topic), time, data) for topic, time, data in found.messages] == messages[:complete]
    assert bool(found.fault) == (length < len(content))


def message_ends(content: bytes) -> Iterator[int]:
    """Yield where each message of a file ends, by the lengths of its records."""
    offset = 8
    while content[offset] != 0x0F:
        (size,) = struct.unpack_from('<Q', content, offset + 1)
        if content[offset] == 6:
            # The records of a chunk are records too.
            offset += 49
            continue
        offset += 9 + size
        if content[offset - 9 - size] == 5:
            yield offset


@PROPERTIES
@given(parts=PARTS, options=OPTIONS)
def test_compressed_and_split(tmp_path, small_chunks, parts, options):
    path = fresh(tmp_path) / 'bag'
    messages = write(path, parts, options)
    in_order = sorted(messages, key=lambda message: message[1])
    if not options.splits:
        assert read_by_rosbags(path)[1] == in_order
    information = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    names = information['relative_file_paths']
    assert names == [f'bag_{n}.mcap' for n in range(len(names))] if options.splits else ['bag.mcap']
    assert sorted(names) == sorted(file.name for file in path.glob('*.mcap'))
    assert information['message_count'] == len(messages) == sum(file['message_count'] for file in information['files'])
    # Each file is whole by itself: together they hold the messages in the order in which they were written.
    found = []
    for name, listed in zip(names, information['files'], strict=True):
        content = (path / name).read_bytes()
        reader = NonSeekingReader(io.BytesIO(content), validate_crcs=True)
        here = [
            (NAMES.index(channel.topic), message.log_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        assert len(here) == listed['message_count']
        times = [time for _, time, _ in here]
        if times:
            assert listed['starting_time']['nanoseconds_since_epoch'] == min(times)
            assert listed['duration']['nanoseconds'] == max(times) - min(times)
            longest = options.max_bag_duration * 1e9
            assert not longest or messages != in_order or max(times) - min(times) <= longest
        found += here
    assert found == messages
    bag = Bag(path)
    for index, name in enumerate(NAMES):
        column = bag.column(name)
        expected = [(time, data) for topic, time, data in in_order if topic == index]
        assert list(zip(column.times.tolist(), column.as_bytes(), strict=True)) == expected


def test_rosbags_reads_a_split_bag(tmp_path):
    """Its reader takes the files of a bag together where their times follow each other."""
    ticks = Ticks([100_000 * tick for tick in range(2000)], [12, 60, 60], 1)
    messages = write(tmp_path / 'bag', [((0, 1, 2), ticks)], BagOptions(compression='zstd', max_bag_duration=0.05))
    information = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    # A file goes on up to the last tick that is no later than that after its first.
    assert [file['message_count'] // 3 for file in information['files']] == [501, 501, 501, 497]
    assert read_by_rosbags(tmp_path / 'bag')[1] == messages


@pytest.mark.parametrize(('size', 'compression'), [(2_500_000, 'none'), (2_500_000, 'zstd')])
def test_a_file_exceeds_the_largest_size_by_a_chunk_at_most(tmp_path, size, compression):
    ticks = Ticks([100_000 * tick for tick in range(30_000)], [12, 60, 120], 1)
    write(tmp_path / 'bag', [((0, 1, 2), ticks)], BagOptions(compression=compression, max_bag_size=size))
    *whole, last = sorted((tmp_path / 'bag').glob('*.mcap'))
    assert len(whole) > 1
    assert all(size < file.stat().st_size < size + 2**20 + 300_000 for file in whole)
    assert last.stat().st_size < size + 2**20 + 300_000


@PROPERTIES
@given(parts=PARTS, cut=st.floats(0.0, 1.0), hole=st.integers(0, 500))
def test_a_compressed_file_that_is_cut_off_or_ends_in_zeros(tmp_path, small_chunks, parts, cut, hole):
    base = fresh(tmp_path)
    messages = write(base / 'bag', parts, BagOptions(compression='zstd'))
    path = base / 'bag' / 'bag.mcap'
    content = path.read_bytes()
    length = int(cut * len(content))
    path.write_bytes(content[:length] + bytes(min(hole, len(content) - length)))
    found = salvage(path)
    # Every chunk that was complete is there, but for a message before zeros, and of the next one nothing that was not
    # written.
    complete = sum(count for end, count in chunk_ends(content) if end <= length)
    assert complete - (hole > 0) <= len(found.messages)
    assert [(NAMES.index(topic), time, data) for topic, time, data in found.messages] == messages[: len(found.messages)]


def chunk_ends(content: bytes) -> Iterator[tuple[int, int]]:
    """Yield where each chunk of a file ends, and how many messages it has, by its indexes."""
    summary = SeekingReader(io.BytesIO(content)).get_summary()
    assert summary is not None
    for chunk in summary.chunk_indexes:
        sizes = [struct.unpack_from('<Q', content, at + 1)[0] - 6 for at in chunk.message_index_offsets.values()]
        yield chunk.chunk_start_offset + chunk.chunk_length, sum(sizes) // 16


def test_a_cut_in_a_compressed_chunk_leaves_its_first_blocks(tmp_path):
    ticks = Ticks([100_000 * tick for tick in range(10_000)], [12, 60, 60], 1)
    messages = write(tmp_path / 'bag', [((0, 1, 2), ticks)], BagOptions(compression='zstd'))
    path = tmp_path / 'bag' / 'bag.mcap'
    content = path.read_bytes()
    ((end, count), *_) = chunk_ends(content)
    path.write_bytes(content[: end - 100_000])
    found = salvage(path)
    assert 'truncated at byte' in found.fault
    assert 0.5 * count < len(found.messages) < count
    assert [data for _, _, data in found.messages] == [data for _, _, data in messages[: len(found.messages)]]


def test_damage_in_a_compressed_chunk_is_found(tmp_path):
    ticks = Ticks([100_000 * tick for tick in range(1000)], [12, 60, 60], 1)
    write(tmp_path / 'bag', [((0, 1, 2), ticks)], BagOptions(compression='zstd'))
    path = tmp_path / 'bag' / 'bag.mcap'
    content = bytearray(path.read_bytes())
    content[20_000] ^= 0xFF
    path.write_bytes(content)
    assert 'damaged' in salvage(path).fault
    with pytest.raises(BagError, match='damaged'):
        Bag(tmp_path / 'bag').column('/clock')


def test_chunks_are_no_larger_than_those_of_rosbags(tmp_path):
    """What a crash of the writing process can lose is a chunk."""
    ticks = Ticks([100_000 * tick for tick in range(20_000)], [12, 60, 60], 1)
    messages = write(tmp_path / 'ours' / 'bag', [((0, 1, 2), ticks)])
    write_by_rosbags(tmp_path / 'theirs' / 'bag', messages)
    sizes = []
    for side in ('ours', 'theirs'):
        with (tmp_path / side / 'bag' / 'bag.mcap').open('rb') as file:
            summary = SeekingReader(file).get_summary()
            assert summary is not None
            sizes.append([chunk.uncompressed_size for chunk in summary.chunk_indexes])
    assert len(sizes[0]) > 3
    assert max(sizes[0]) <= max(sizes[1])


def test_what_is_written_is_in_the_file_chunk_by_chunk(tmp_path):
    """A writer that is killed leaves every chunk but the last."""
    writer = BagWriter(tmp_path / 'bag', 'mcap', TOPICS, {})
    ticks = Ticks([100_000 * tick for tick in range(20_000)], [12, 60, 60], 1)
    writer.write_ticks((0, 1, 2), ticks)
    written = salvage(tmp_path / 'bag' / 'bag.mcap').messages
    size = sum(31 + size for size in (12, 60, 60))
    assert len(written) > 3 * (20_000 - 2**20 // size - 1)


def test_numbers_of_messages_that_differ(tmp_path):
    writer = BagWriter(tmp_path / 'bag', 'mcap', TOPICS, {})
    with pytest.raises(ValueError, match='1 topics and 2 stamps for 1 messages'):
        writer.write([0], [1, 2], [b'abc'])
