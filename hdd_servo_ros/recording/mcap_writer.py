"""
Bulk writer of MCAP files, with one array for many messages and one for the index of a chunk.

The records are those of https://mcap.dev/spec, sections "Records" (each with its opcode, fields and byte order),
"Chunk", "Message Index" and "Summary Section"; comments below name the record. All numbers are little-endian. The
libraries that write MCAP (`rosbags`, `mcap`, `foxglove-sdk`) accept only single messages.
"""

import dataclasses
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.tick_messages import TickMessages
from hdd_servo_ros.recording.crc import combined_crc
from hdd_servo_ros.recording.disk import write_all
from hdd_servo_ros.recording.zstd import compress

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(0x0B, 0x10)
CHUNK_SIZE = 2**20
"""Largest size of a chunk [bytes]; :meth:`McapWriter.flush` closes it earlier."""

MESSAGE_HEAD = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)
"""Header of a Message record."""
_OPCODE_AND_LENGTH = 9
_LOG_TIME, _PUBLISH_TIME = 15, 23
"""Offsets of the times in the header."""
INDEX_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
"""Entry of a Message Index: log time, and offset of the message in the uncompressed chunk."""


@dataclasses.dataclass(frozen=True)
class Channel:
    """
    Topic of a file.

    Attributes
    ----------
    topic
        Full name.
    type_name, definition
        Name and text of the message type: name and data of the Schema record.
    encoding
        Encoding of the definition: encoding of the Schema record.
    metadata
        Metadata of the Channel record.
    """

    topic: str
    type_name: str
    definition: str
    encoding: str
    metadata: Mapping[str, str]


class McapWriter:
    """
    Writer of a new MCAP file.

    Parameters
    ----------
    path
        Path of the file, which must not exist.
    channels
        Topics; messages refer to a topic by its index here.
    library
        Name of the writer in the Header record.
    compression
        Compression of the chunks: ``none`` or ``zstd``.
    keep_room
        Function called with the size of the summary [bytes] before it grows by another chunk. It reserves disk space,
        which must be available when :meth:`write_summary` is called, and raises OSError if the disk is full.

    Raises
    ------
    FileExistsError
        If the file exists.
    OSError
        From any method, if the file cannot be written. The file on the disk then ends with a complete chunk, and the
        summary can still be written.
    """

    def __init__(
        self,
        path: Path,
        channels: Sequence[Channel],
        library: str,
        compression: str = 'none',
        keep_room: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._compress = _COMPRESSIONS[compression]
        self._compression = b'' if compression == 'none' else compression.encode()
        self._path = path
        self._keep_room = keep_room
        # Unbuffered: writes are large, and after an error no data may remain to be written again.
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._size = 0
        self._crc = 0
        self._counts = np.zeros(len(channels), dtype=np.int64)
        self._chunk = _Chunk(len(channels))
        self._chunk_indexes: list[bytes] = []
        self._index_size = 0
        self._first, self._last = _NO_TIMES
        self._schemas, self._channels = _schemas_and_channels(channels)
        self._put(MAGIC + _record(HEADER, _text('ros2') + _text(library)))
        self._chunk.append(np.frombuffer(b''.join((*self._schemas, *self._channels)), dtype=np.uint8))

    @property
    def is_closed(self) -> bool:
        """Whether the file is complete."""
        return self._file < 0

    @property
    def size(self) -> int:
        """Size of the file, without the chunk in memory [bytes]."""
        return self._size

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of messages of each topic."""
        return self._counts

    @property
    def times(self) -> tuple[int, int] | None:
        """First and last log time [ns]; None without messages."""
        first, last = self._chunk.times
        return (min(self._first, first), max(self._last, last)) if self._counts.any() else None

    def write_ticks(self, topics: Sequence[int], messages: TickMessages, ticks: slice) -> None:
        """Write the messages of some ticks, one per topic and tick, in the order of ``topics`` within each tick."""
        template, starts = _tick_template(topics, messages.templates)
        width = len(template)
        times = messages.times
        first = ticks.start
        while first < ticks.stop:
            self._make_room(width)
            count = min(self._chunk.room // width, ticks.stop - first)
            rows = self._chunk.take(count * width).reshape(count, width)
            rows[:] = template
            part = slice(first, first + count)
            stamps = times[part].astype('<u8')
            payloads = []
            for start, message in zip(starts, messages.templates, strict=True):
                for field in (_LOG_TIME, _PUBLISH_TIME):
                    rows[:, start + field : start + field + 8].view('<u8')[:, 0] = stamps
                data = start + MESSAGE_HEAD.itemsize
                payloads.append(rows[:, data : data + len(message)])
            messages.fill(part, payloads)
            entries = np.empty((len(topics), count), dtype=INDEX_ENTRY)
            entries['time'] = stamps
            begin = self._chunk.size - count * width
            entries['offset'] = np.add.outer(starts, np.arange(begin, begin + count * width, width))
            self._enter(topics, entries, stamps)
            first += count

    def write_messages(
        self,
        topics: NDArray[np.int64],
        times: NDArray[np.int64],
        sizes: NDArray[np.int64],
        payloads: memoryview,
    ) -> None:
        """
        Write messages of any size in any order.

        Parameters
        ----------
        topics, times, sizes
            Index of the topic, log time [ns] and size [bytes] of each message, shape (n,).
        payloads
            Concatenated messages.
        """
        heads = np.zeros(len(topics), dtype=MESSAGE_HEAD)
        heads['opcode'] = MESSAGE
        heads['length'] = sizes + (MESSAGE_HEAD.itemsize - _OPCODE_AND_LENGTH)
        heads['channel'] = topics + 1
        heads['log_time'] = heads['publish_time'] = times
        records: list[bytes | memoryview] = [b''] * (2 * len(topics))
        records[0::2] = _cut(heads.view(np.uint8).data, [MESSAGE_HEAD.itemsize] * len(topics))
        records[1::2] = _cut(payloads, sizes.tolist())
        data = np.frombuffer(b''.join(records), dtype=np.uint8)
        ends = np.cumsum(sizes + MESSAGE_HEAD.itemsize)
        starts = ends - sizes - MESSAGE_HEAD.itemsize
        first = 0
        while first < len(topics):
            begin = int(starts[first])
            self._make_room(int(ends[first]) - begin)
            last = int(np.searchsorted(ends, begin + self._chunk.room, side='right'))
            part = slice(first, last)
            entries = np.empty(last - first, dtype=INDEX_ENTRY)
            entries['time'] = times[part]
            entries['offset'] = self._chunk.size + starts[part] - begin
            self._chunk.append(data[begin : int(ends[last - 1])])
            there = list(dict.fromkeys(topics[part].tolist()))
            self._enter(there, [entries[topics[part] == topic] for topic in there], times[part])
            first = last

    def _make_room(self, size: int) -> None:
        """Ensure that a record of ``size`` bytes fits into the chunk."""
        if self._chunk.room < size and self._chunk.has_messages:
            self._close_chunk()
        # A chunk grows for a record that is larger than a chunk.
        self._chunk.reserve(size)

    def _enter(self, topics: Sequence[int], entries: Iterable[NDArray[np.void]], times: NDArray[np.integer]) -> None:
        """Enter messages into the index: entries per topic, and the times of all messages."""
        for topic, of_topic in zip(topics, entries, strict=True):
            self._counts[topic] += len(of_topic)
            self._chunk.enter(topic, of_topic)
        first, last = self._chunk.times
        self._chunk.times = min(first, int(times.min())), max(last, int(times.max()))

    def flush(self) -> None:
        """Write the chunk in memory if it has messages, so that they survive the end of this process."""
        if self._chunk.has_messages:
            self._close_chunk()

    def _put(self, data: bytes | memoryview, crc: int | None = None) -> None:
        """Write data; ``crc`` is its checksum, if known."""
        try:
            write_all(self._file, memoryview(data))
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from None
        self._crc = zlib.crc32(data, self._crc) if crc is None else combined_crc(self._crc, crc, len(data))
        self._size += len(data)

    def _close_chunk(self) -> None:
        """Write the chunk with its Message Index records, and begin another."""
        size, crc, times = self._size, self._crc, (self._first, self._last)
        try:
            self._keep_room(self._index_size + _LARGEST_CHUNK_INDEX + _TOPIC_IN_CHUNK_INDEX * len(self._channels))
            self._write_chunk()
        except OSError:
            # Undo the whole chunk: it must not be truncated, and the summary needs the reserved space.
            os.ftruncate(self._file, size)
            os.lseek(self._file, size, os.SEEK_SET)
            self._size, self._crc, (self._first, self._last) = size, crc, times
            for topic, entries in self._chunk.entries():
                self._counts[topic] -= sum(len(part) for part in entries)
            self._chunk.clear()
            raise
        self._chunk.clear()

    def _write_chunk(self) -> None:
        chunk, start = self._chunk, self._size
        first, last = chunk.times
        self._first, self._last = min(self._first, first), max(self._last, last)
        if not chunk.has_messages:
            first = last = 0
        records = self._compress(chunk.records)
        crc = zlib.crc32(chunk.records)
        head = struct.pack('<QQQI', first, last, chunk.size, crc)
        head += _bytes(self._compression) + struct.pack('<Q', len(records))
        self._put(struct.pack('<BQ', CHUNK, len(head) + len(records)) + head)
        self._put(records, None if self._compression else crc)
        end = self._size
        offsets, offset = [], end
        index: list[bytes | memoryview] = []
        for topic, entries in chunk.entries():
            offsets.append(struct.pack('<HQ', topic + 1, offset))
            size = INDEX_ENTRY.itemsize * sum(len(part) for part in entries)
            index += [struct.pack('<BQHI', MESSAGE_INDEX, 6 + size, topic + 1, size), *map(_buffer, entries)]
            offset += 15 + size
        self._put(b''.join(index))
        record = _record(
            CHUNK_INDEX,
            struct.pack('<QQQQ', first, last, start, end - start)
            + _bytes(b''.join(offsets))
            + struct.pack('<Q', self._size - end)
            + _bytes(self._compression)
            + struct.pack('<QQ', len(records), chunk.size),
        )
        self._chunk_indexes.append(record)
        self._index_size += len(record)

    def close(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write the last chunk, a Metadata record of this name, and the summary; the file is then complete."""
        self.finish_data()
        self.write_summary(name, metadata)

    def finish_data(self) -> None:
        """Write the last chunk; without messages it contains only the topics."""
        if self._chunk.size:
            self._close_chunk()

    def write_summary(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a Metadata record of this name and the summary of the chunks on the disk, and close the file."""
        size, crc = self._size, self._crc
        try:
            self._write_summary(name, metadata)
        except OSError:
            os.ftruncate(self._file, size)
            os.lseek(self._file, size, os.SEEK_SET)
            self._size, self._crc = size, crc
            raise
        os.close(self._file)
        self._file = -1

    def _write_summary(self, name: str, metadata: Mapping[str, str]) -> None:
        start = self._size
        self._put(_record(METADATA, _text(name) + _map(metadata)))
        index = _record(METADATA_INDEX, struct.pack('<QQ', start, self._size - start) + _text(name))
        self._put(_record(DATA_END, struct.pack('<I', self._crc)))
        groups = (
            (SCHEMA, self._schemas),
            (CHANNEL, self._channels),
            (CHUNK_INDEX, self._chunk_indexes),
            (METADATA_INDEX, [index]),
            (STATISTICS, [self._statistics()]),
        )
        summary, offsets = b'', b''
        for opcode, records in groups:
            group = b''.join(records)
            if group:
                offset = self._size + len(summary)
                offsets += _record(SUMMARY_OFFSET, struct.pack('<BQQ', opcode, offset, len(group)))
            summary += group
        # The checksum covers the summary and the Footer up to the checksum itself.
        footer = struct.pack('<BQQQ', FOOTER, 20, self._size, self._size + len(summary))
        content = summary + offsets + footer
        self._put(content + struct.pack('<I', zlib.crc32(content)) + MAGIC)

    def _statistics(self) -> bytes:
        first, last = self.times or (0, 0)
        counts = b''.join(struct.pack('<HQ', index + 1, count) for index, count in enumerate(self._counts.tolist()))
        numbers = int(self._counts.sum()), len(self._schemas), len(self._channels), 0, 1, len(self._chunk_indexes)
        return _record(STATISTICS, struct.pack('<QHIIIIQQ', *numbers, first, last) + _bytes(counts))


_NO_TIMES = 2**63 - 1, 0
_LARGEST_CHUNK_INDEX, _TOPIC_IN_CHUNK_INDEX = 100, 10
"""Size of a Chunk Index record without topics, rounded up, and size per topic [bytes]."""


class _Chunk:
    """Records of the next chunk."""

    def __init__(self, topics: int) -> None:
        self._buffer = np.empty(CHUNK_SIZE, dtype=np.uint8)
        self._entries: list[list[NDArray[np.void]]] = [[] for _ in range(topics)]
        self._order: dict[int, None] = {}
        self.size = 0
        self.times = _NO_TIMES

    @property
    def records(self) -> memoryview:
        return self._buffer[: self.size].data

    @property
    def room(self) -> int:
        return len(self._buffer) - self.size

    @property
    def has_messages(self) -> bool:
        return bool(self._order)

    def reserve(self, size: int) -> None:
        if self.room < size:
            self._buffer = np.concatenate((self._buffer[: self.size], np.empty(size, dtype=np.uint8)))

    def take(self, size: int) -> NDArray[np.uint8]:
        """Return the next ``size`` bytes, which the caller fills."""
        self.reserve(size)
        self.size += size
        return self._buffer[self.size - size : self.size]

    def append(self, records: NDArray[np.uint8]) -> None:
        self.take(len(records))[:] = records

    def enter(self, topic: int, entries: NDArray[np.void]) -> None:
        """Add index entries of a topic."""
        self._entries[topic].append(entries)
        self._order[topic] = None

    def entries(self) -> Iterable[tuple[int, list[NDArray[np.void]]]]:
        """Iterate over the topics in the order of their first messages, with their index entries."""
        return ((topic, self._entries[topic]) for topic in self._order)

    def clear(self) -> None:
        self._buffer = self._buffer[:CHUNK_SIZE]
        for topic in self._order:
            self._entries[topic] = []
        self._order = {}
        self.size = 0
        self.times = _NO_TIMES


def _tick_template(topics: Sequence[int], messages: Sequence[bytes]) -> tuple[NDArray[np.uint8], list[int]]:
    """Return the Message records of a tick, and the offset of each."""
    records, starts, offset = [], [], 0
    for topic, message in zip(topics, messages, strict=True):
        length = MESSAGE_HEAD.itemsize - _OPCODE_AND_LENGTH + len(message)
        head = np.array((MESSAGE, length, topic + 1, 0, 0, 0), dtype=MESSAGE_HEAD)
        records.append(head.tobytes() + message)
        starts.append(offset)
        offset += len(records[-1])
    return np.frombuffer(b''.join(records), dtype=np.uint8), starts


def _schemas_and_channels(channels: Sequence[Channel]) -> tuple[list[bytes], list[bytes]]:
    """Return the Schema records, one per message type, and the Channel records."""
    numbers: dict[str, int] = {}
    schemas, records = [], []
    for index, channel in enumerate(channels):
        if channel.type_name not in numbers:
            numbers[channel.type_name] = len(numbers) + 1
            content = _text(channel.type_name) + _text(channel.encoding) + _text(channel.definition)
            schemas.append(_record(SCHEMA, struct.pack('<H', numbers[channel.type_name]) + content))
        head = struct.pack('<HH', index + 1, numbers[channel.type_name])
        records.append(_record(CHANNEL, head + _text(channel.topic) + _text('cdr') + _map(channel.metadata)))
    return schemas, records


def _buffer(entries: NDArray[np.void]) -> memoryview:
    return entries.view(np.uint8).data


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(content)) + content


def _bytes(data: bytes) -> bytes:
    return struct.pack('<I', len(data)) + data


def _text(text: str) -> bytes:
    return _bytes(text.encode())


def _map(texts: Mapping[str, str]) -> bytes:
    return _bytes(b''.join(_text(key) + _text(text) for key, text in texts.items()))


def _cut(data: memoryview, sizes: Iterable[int]) -> list[memoryview]:
    parts, offset = [], 0
    for size in sizes:
        parts.append(data[offset : offset + size])
        offset += size
    return parts


def _uncompressed(data: memoryview) -> memoryview:
    return data


_COMPRESSIONS: dict[str, Callable[[memoryview], bytes | memoryview]] = {
    'none': _uncompressed,
    'zstd': compress,
}
