"""
Bulk reader of rosbag2 bags, topic by topic.

All messages of a loop topic have the same size, so that a topic of 100,000 ticks is one array of bytes. MCAP files,
compressed by zstd or not, are read through their message indexes, and sqlite3 files by one query per topic. MCAP files
without the optional parts (message indexes, channels repeated in the summary) are read from the start. All other bags,
such as those compressed by rosbag2, are read message by message with `rosbags`.

A changed byte in a bag of this package is never read as data. An MCAP file is checked by the checksums of its data
section and its summary (:meth:`Bag.check`) or of its chunks, and the rows of an sqlite3 file by a digest per topic.
"""

import contextlib
import dataclasses
import mmap
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.exit_codes import UNREADABLE
from hdd_servo_ros.recording.bag_digest import TopicDigest
from hdd_servo_ros.recording.bag_metadata import FILE_NAME, MetadataError, read_metadata
from hdd_servo_ros.recording.chunk_compression import DECOMPRESS
from hdd_servo_ros.recording.mcap_checks import CheckError, check_mcap

if TYPE_CHECKING:
    import sqlite3

    from hdd_servo_ros.recording.salvage import Salvage

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_CHANNEL, _MESSAGE, _CHUNK_INDEX = 0x04, 0x05, 0x08
_FOOTER_SIZE = 37
"""Footer record and closing magic [bytes]."""
_INDEX_HEAD = 15
"""Opcode and length of a message index record, its channel, and the length of its entries [bytes]."""
_MESSAGE_HEAD = 31
"""Opcode and length of a message record, channel, sequence number and two times, before the payload [bytes]."""
_INDEX_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])
_ROWS_AT_ONCE = 2**14
"""Number of rows of an sqlite3 file that are read at once."""


WRONG_DIGEST = 'is damaged: the messages do not match their checksum'
"""End of the error message for a topic with a wrong digest."""


class BagError(ValueError):
    """A bag that cannot be read; the text names the bag and the reason."""

    exit_code = UNREADABLE


def bag_directory(path: Path) -> Path:
    """
    Return the bag of a run directory, or the path itself if it is a bag.

    Raises
    ------
    FileNotFoundError
        If it is neither, or a run whose bag was not closed.
    """
    for candidate in (path / 'bag', path):
        if (candidate / 'metadata.yaml').is_file():
            return candidate
    if (path / 'run.yaml').is_file() and any((path / 'bag').glob('*')):
        raise FileNotFoundError(f'{path}: the bag was not closed (no metadata.yaml); `recover {path}` repairs it')
    raise FileNotFoundError(f'{path} is neither a run folder nor a closed bag: no metadata.yaml in it or in its bag/')


@dataclasses.dataclass(frozen=True)
class Column:
    """
    Messages of one topic, ordered by time.

    Attributes
    ----------
    times
        Receive times [ns], shape (n,).
    payloads
        Serialized messages: an array of bytes, shape (n, size), if all have the same size, otherwise a list.
    """

    times: NDArray[np.int64]
    payloads: NDArray[np.uint8] | list[bytes]

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, rows: slice) -> 'Column':
        """Return a part of the messages."""
        return Column(self.times[rows], self.payloads[rows])

    def as_bytes(self) -> list[bytes]:
        """Return the payloads one by one."""
        return self.payloads if isinstance(self.payloads, list) else [row.tobytes() for row in self.payloads]


class Bag:
    """
    Closed rosbag2 bag.

    Parameters
    ----------
    path
        Directory with ``metadata.yaml``.

    Raises
    ------
    BagError
        If the metadata cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            metadata = read_metadata(path)
        except OSError as error:
            raise BagError(f'{path / FILE_NAME}: {error.strerror or error}') from None
        except MetadataError as error:
            raise BagError(f'{path / FILE_NAME} cannot be read: {error}') from None
        self.types = metadata.types
        """Type of each topic, by its full name."""
        self.counts = metadata.counts
        """Number of messages of each topic."""
        self.custom_data = metadata.custom_data
        """Metadata that the recorder stored in the bag."""
        self._storage = metadata.storage
        self._compressed = metadata.is_compressed
        self._files = [path / name for name in metadata.files]
        self._checked: dict[Path, _Checked] = {file: _Checked() for file in self._files}
        self._walked: dict[Path, Salvage] = {}
        self._digests = metadata.digests

    def check(self) -> bool:
        """
        Check all bytes of the MCAP files, if they contain checksums.

        Rows of an sqlite3 file are checked when a topic is read.

        Returns
        -------
        bool
            Whether every byte of the files was checked.

        Raises
        ------
        BagError
            If a file is missing or damaged.
        """
        is_checked = True
        for file in self._files:
            try:
                if self._storage == 'mcap' and not self._compressed and check_mcap(file):
                    self._checked[file].set_all(file.stat())
                    continue
                is_checked = False
                if not file.is_file():
                    raise BagError(f'{file} is missing')
            except (OSError, CheckError) as error:
                raise BagError(f'{file}: {error}') from None
        return is_checked

    def column(self, topic: str) -> Column:
        """
        Return the messages of a topic, given by its full name.

        Raises
        ------
        KeyError
            If the bag lacks the topic.
        BagError
            If a file is damaged.
        """
        if topic not in self.types:
            raise KeyError(topic)
        parts: list[Column] | None = None
        if not self._compressed and self._storage in _BULK_READERS:
            with contextlib.suppress(_NotInBulk):
                parts = [_BULK_READERS[self._storage](file, topic, self._checked[file]) for file in self._files]
        if parts is None and not self._compressed and self._storage == 'mcap':
            parts = self._walk(topic)
        if parts is None:
            parts = [self._read_one_by_one(topic)]
        column = joined(parts)
        if len(column) != self.counts[topic] and self._storage == 'mcap' and not self._compressed:
            # Messages outside of chunks are not in the index.
            column = joined(self._walk(topic) or [column])
        if len(column) != self.counts[topic]:
            raise BagError(
                f'{self.path}: {topic} has {len(column)} messages, but {self.counts[topic]} according to metadata.yaml'
            )
        # The digest covers the messages in the order of writing, which can differ from the order of time.
        if self._storage == 'sqlite3' and topic in self._digests and _digest_of(parts) != self._digests[topic]:
            raise BagError(f'{self.path}: {topic} {WRONG_DIGEST}')
        return column

    def pieces(self, topics: Sequence[str], since: int = 0) -> Iterator[dict[str, Column]]:
        """
        Iterate over the messages of some topics, given by their full names, in the order of the files.

        At most one chunk of an indexed MCAP file, or some thousand rows of an sqlite3 file, are in memory at once.
        Other files are read as a whole.

        Parameters
        ----------
        topics
            Full names of the topics.
        since
            Receive time [ns] of the first message wanted. Earlier messages are skipped, if possible without reading
            them, and the number and digest of messages are then not checked.

        Yields
        ------
        dict
            The next messages, by topic; without topics that have none in the chunk.

        Raises
        ------
        KeyError
            If the bag lacks the topic.
        BagError
            If a file is damaged.
        """
        readers = None if self._compressed else self._piece_readers(topics, since)
        if readers is None:
            columns = {topic: self.column(topic) for topic in topics}
            yield {topic: column[int(np.searchsorted(column.times, since)) :] for topic, column in columns.items()}
            return
        left = {topic: self.counts[topic] for topic in topics}
        digests = {topic: TopicDigest() for topic in topics if self._storage == 'sqlite3' and topic in self._digests}
        for reader in readers:
            for piece in reader:
                for topic, column in piece.items():
                    left[topic] -= len(column)
                    if topic in digests:
                        _add_to_digest(digests[topic], column)
                yield piece
        if since > 0:
            return
        for topic, count in left.items():
            if count:
                held = self.counts[topic] - count
                raise BagError(
                    f'{self.path}: {topic} has {held} messages, but {self.counts[topic]} according to metadata.yaml'
                )
        for topic, digest in digests.items():
            if digest.text != self._digests[topic]:
                raise BagError(f'{self.path}: {topic} {WRONG_DIGEST}')

    def _piece_readers(self, topics: Sequence[str], since: int) -> list[Iterator[dict[str, Column]]] | None:
        """Return one iterator over pieces per file; None if the files cannot be read in pieces."""
        if self._storage == 'sqlite3':
            return [_sqlite3_pieces(file, topics, since) for file in self._files]
        files = self._indexed_files() if self._storage == 'mcap' else None
        return None if files is None else [file.pieces(topics, since) for file in files]

    def _indexed_files(self) -> 'list[_McapFile] | None':
        """Return the files if all are MCAP files with indexes, otherwise None."""
        try:
            return [_open_mcap(file, self._checked[file]) for file in self._files]
        except _NotInBulk:
            return None

    def _walk(self, topic: str) -> list[Column] | None:
        """Read MCAP files from the start, without their indexes; return None if they have unsupported content."""
        # Imported only if needed: few bags have no index.
        from hdd_servo_ros.recording.salvage import salvage

        for file in self._files:
            if file not in self._walked:
                try:
                    self._walked[file] = salvage(file)
                except OSError as error:
                    raise BagError(f'{file}: {error.strerror}') from None
            if self._walked[file].unknown:
                return None
            if self._walked[file].fault:
                raise BagError(f'{file}: {self._walked[file].fault}')
        columns = []
        for file in self._files:
            own = [(time, data) for name, time, data in self._walked[file].messages if name == topic]
            columns.append(_column([time for time, _ in own], [data for _, data in own]))
        return columns

    def _read_one_by_one(self, topic: str) -> Column:
        # Imported only if needed: the import takes longer than reading most bags.
        from rosbags.rosbag2 import Reader

        times, payloads = [], []
        try:
            with Reader(self.path) as reader:
                connections = [connection for connection in reader.connections if connection.topic == topic]
                for _, time, payload in reader.messages(connections):
                    times.append(time)
                    payloads.append(bytes(payload))
        except Exception as error:  # rosbags raises errors of any type for a damaged file
            raise BagError(f'{self.path}: {error}') from None
        return _column(times, payloads)


class _Checked:
    """Chunks of a file with verified checksums, because verifying takes most of the time of reading another topic."""

    def __init__(self) -> None:
        self._version = (0, 0)
        self._starts: set[int] = set()

    def of(self, file: os.stat_result) -> set[int]:
        """Return the offsets of the verified chunks; empty if the file has changed since."""
        version = (file.st_size, file.st_mtime_ns)
        if version != self._version:
            self._version, self._starts = version, set()
        return self._starts

    def set_all(self, file: os.stat_result) -> None:
        """Mark all chunks of the file as verified."""
        self._version, self._starts = (file.st_size, file.st_mtime_ns), _All()


class _All(set[int]):
    """Set that contains every element."""

    def __contains__(self, _: object) -> bool:
        return True


class _NotInBulk(Exception):
    """Signal that only the general reader can read a file."""


def _column(times: Sequence[int], payloads: list[bytes]) -> Column:
    stamps = np.array(times, dtype=np.int64)
    sizes = set(map(len, payloads))
    if len(sizes) != 1:
        return Column(stamps, payloads)
    return Column(stamps, np.frombuffer(b''.join(payloads), dtype=np.uint8).reshape(len(payloads), sizes.pop()))


def joined(parts: Sequence[Column]) -> Column:
    """Return the messages of several parts of a topic as a single column, ordered by time."""
    if len(parts) == 1 and not np.any(parts[0].times[1:] < parts[0].times[:-1]):
        return parts[0]
    parts = [part for part in parts if len(part)]
    if not parts:
        return Column(np.zeros(0, dtype=np.int64), [])
    times = np.concatenate([part.times for part in parts])
    arrays = [part.payloads for part in parts if not isinstance(part.payloads, list)]
    payloads: NDArray[np.uint8] | list[bytes]
    if len(arrays) == len(parts) and len({array.shape[1] for array in arrays}) == 1:
        payloads = np.concatenate(arrays)
    else:
        payloads = [payload for part in parts for payload in part.as_bytes()]
    if np.any(times[1:] < times[:-1]):
        order = np.argsort(times, kind='stable')
        times = times[order]
        payloads = [payloads[index] for index in order] if isinstance(payloads, list) else payloads[order]
    return Column(times, payloads)


def _digest_of(parts: Sequence[Column]) -> str:
    digest = TopicDigest()
    for part in parts:
        _add_to_digest(digest, part)
    return digest.text


def _add_to_digest(digest: TopicDigest, part: Column) -> None:
    digest.add(part.times, b''.join(part.payloads) if isinstance(part.payloads, list) else part.payloads)


@contextlib.contextmanager
def _database(path: Path) -> Iterator['sqlite3.Connection']:
    """Open an sqlite3 file for reading; raise :class:`BagError` instead of errors of SQLite."""
    # Imported only if needed: most bags are MCAP.
    import sqlite3

    from hdd_servo_ros.recording.sqlite_reading import database_to_read

    try:
        with database_to_read(path) as address, contextlib.closing(sqlite3.connect(address, uri=True)) as connection:
            yield connection
    except (sqlite3.Error, OSError, OverflowError) as error:
        raise BagError(f'{path}: {error}') from None


def _read_sqlite3(path: Path, topic: str, _: _Checked) -> Column:
    with _database(path) as database:
        # By id, the order of writing.
        rows = database.execute(
            'SELECT timestamp, data FROM messages WHERE topic_id IN (SELECT id FROM topics WHERE name = ?) ORDER BY id',
            (topic,),
        ).fetchall()
        _check_rows(path, topic, rows)
    return _column([time for time, _ in rows], [payload for _, payload in rows])


def _check_rows(path: Path, topic: str, rows: Sequence[tuple[Any, Any]]) -> None:
    from hdd_servo_ros.recording.sqlite_topics import is_message

    if not all(is_message(time, payload) for time, payload in rows):
        raise BagError(f'{path}: a row of {topic} is not a message')


def _sqlite3_pieces(path: Path, topics: Sequence[str], since: int) -> Iterator[dict[str, Column]]:
    """Iterate over the messages of some topics in the order of writing, some thousand at once."""
    with _database(path) as database:
        names = dict(database.execute('SELECT id, name FROM topics'))
        wanted = [number for number, name in names.items() if name in topics]
        placeholders = ', '.join('?' * len(wanted))
        # The index on the time finds the first row; `+timestamp` below prevents its use for ordering.
        begin = database.execute('SELECT min(id) FROM messages WHERE timestamp >= ?', (since,)) if since else None
        first = 0 if begin is None else begin.fetchone()[0] or 0
        cursor = database.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({placeholders}) '
            'AND id >= ? AND +timestamp >= ? ORDER BY id',
            (*wanted, first, since),
        )
        while rows := cursor.fetchmany(_ROWS_AT_ONCE):
            piece = {}
            for number in wanted:
                own = [(time, payload) for topic, time, payload in rows if topic == number]
                _check_rows(path, names[number], own)
                if own:
                    piece[names[number]] = _column([time for time, _ in own], [payload for _, payload in own])
            yield piece


def _read_mcap(path: Path, topic: str, checked: _Checked) -> Column:
    with _bag_errors(path):
        return _open_mcap(path, checked).column(topic)


def _open_mcap(path: Path, checked: _Checked) -> '_McapFile':
    with _bag_errors(path), path.open('rb') as file:
        # Closed by the garbage collector, because arrays can still refer to it.
        content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        return _McapFile(path, content, checked.of(os.fstat(file.fileno())))


@contextlib.contextmanager
def _bag_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, struct.error) as error:
        if isinstance(error, BagError):
            raise
        raise BagError(f'{path}: {error}') from None


class _McapFile:
    """MCAP file with a summary section; see https://mcap.dev/spec."""

    def __init__(self, path: Path, content: mmap.mmap, checked: set[int]) -> None:
        self._path = path
        self._content = content
        self._checked = checked
        if len(content) < len(_MCAP_MAGIC) + _FOOTER_SIZE or content[-8:] != _MCAP_MAGIC:
            raise BagError(f'{path}: the file does not end as an MCAP file does')
        (self._summary,) = struct.unpack_from('<Q', content, len(content) - _FOOTER_SIZE + 9)
        if not self._summary:
            raise _NotInBulk
        self._channels: dict[str, set[int]] = {}
        self._chunks: list[tuple[int, dict[int, int]]] = []
        self._ends: dict[int, int] = {}
        """Latest time of each chunk [ns], by the offset of the chunk."""
        self._read_summary()

    def _read_summary(self) -> None:
        offset, end = self._summary, len(self._content) - _FOOTER_SIZE
        while offset < end:
            opcode, size = struct.unpack_from('<BQ', self._content, offset)
            offset += 9
            if opcode == _CHANNEL:
                channel, _, length = struct.unpack_from('<HHI', self._content, offset)
                name = self._content[offset + 8 : offset + 8 + length].decode()
                self._channels.setdefault(name, set()).add(channel)
            elif opcode == _CHUNK_INDEX:
                end_time, start, _, map_size = struct.unpack_from('<QQQI', self._content, offset + 8)
                entries = self._content[offset + 36 : offset + 36 + map_size]
                indexes = dict(struct.iter_unpack('<HQ', entries))
                (length,) = struct.unpack_from('<I', self._content, offset + 36 + map_size + 8)
                compression = self._content[offset + 48 + map_size : offset + 48 + map_size + length]
                if compression.decode(errors='replace') not in DECOMPRESS or not indexes:
                    raise _NotInBulk
                self._chunks.append((start, indexes))
                self._ends[start] = end_time
            offset += size
        if not self._chunks or not self._channels:
            raise _NotInBulk

    def column(self, topic: str) -> Column:
        """Return the messages of a topic in this file."""
        channels = self._channels.get(topic, set())
        return joined(
            [
                self._chunk_column(start, indexes[channel])
                for start, indexes in self._chunks
                for channel in sorted(channels & indexes.keys())
            ]
        )

    def pieces(self, topics: Sequence[str], since: int) -> Iterator[dict[str, Column]]:
        """Iterate over the messages of some topics from a receive time [ns] on, chunk by chunk."""
        channels = {topic: self._channels.get(topic, set()) for topic in topics}
        dropped = 0
        for start, indexes in self._chunks:
            wanted = {topic: sorted(own & indexes.keys()) for topic, own in channels.items() if own & indexes.keys()}
            if not wanted or self._ends[start] < since:
                continue
            with _bag_errors(self._path):
                data = self._chunk_data(start)
                piece = {
                    topic: joined([self._chunk_column(start, indexes[channel], data) for channel in own])
                    for topic, own in wanted.items()
                }
            if since > 0:
                piece = {topic: column[int(np.searchsorted(column.times, since)) :] for topic, column in piece.items()}
            yield piece
            # Release the memory of the part that has been read.
            page = start - start % mmap.PAGESIZE
            if page > dropped and hasattr(self._content, 'madvise'):
                self._content.madvise(mmap.MADV_DONTNEED, dropped, page - dropped)
                dropped = page

    def _chunk_column(self, start: int, index: int, data: memoryview | None = None) -> Column:
        """Return the messages of one channel in the chunk at ``start``, by the index record at ``index``."""
        if data is None:
            data = self._chunk_data(start)
        size = len(data)
        (length,) = struct.unpack_from('<I', self._content, index + _INDEX_HEAD - 4)
        entries = np.frombuffer(self._content, _INDEX_ENTRY, length // _INDEX_ENTRY.itemsize, index + _INDEX_HEAD)
        content = np.frombuffer(data, dtype=np.uint8)
        offsets = entries['offset'].astype(np.int64)
        if len(offsets) and int(offsets.max()) + _MESSAGE_HEAD > size:
            raise BagError(f'{self._path}: the index at byte {index} points beyond its chunk')
        self._check_index(content, entries, offsets, index)
        lengths = _gather(content, offsets + 1, 8).view('<u8')[:, 0].astype(np.int64) - (_MESSAGE_HEAD - 9)
        starts = offsets + _MESSAGE_HEAD
        if np.any(lengths < 0) or np.any(starts + lengths > size):
            raise BagError(f'{self._path}: a message of the chunk at byte {start} is truncated')
        times = entries['time'].astype(np.int64)
        if len(lengths) and np.all(lengths == lengths[0]):
            return Column(times, _gather(content, starts, int(lengths[0])))
        return Column(times, [bytes(data[at : at + size]) for at, size in zip(starts, lengths, strict=True)])

    def _check_index(
        self, content: NDArray[np.uint8], entries: NDArray[np.void], offsets: NDArray[np.int64], index: int
    ) -> None:
        """Check offsets and times in the index, which the checksum of the chunk does not cover."""
        if not len(offsets):
            return
        (channel,) = struct.unpack_from('<H', self._content, index + 9)
        heads = _gather(content, offsets, _MESSAGE_HEAD)
        is_message = (heads[:, 0] == _MESSAGE) & (heads[:, 9:11].copy().view('<u2')[:, 0] == channel)
        if not np.all(is_message & (heads[:, 15:23].copy().view('<u8')[:, 0] == entries['time'])):
            raise BagError(f'{self._path}: the index at byte {index} does not match its chunk')

    def _chunk_data(self, start: int) -> memoryview:
        """Return the records of the chunk at ``start``."""
        size, crc, length = struct.unpack_from('<QII', self._content, start + 25)
        compression = self._content[start + 41 : start + 41 + length]
        (stored,) = struct.unpack_from('<Q', self._content, start + 41 + length)
        begin = start + 49 + length
        data = memoryview(self._content)[begin : begin + stored]
        if len(data) != stored:
            raise BagError(f'{self._path}: the chunk at byte {start} is truncated')
        try:
            data = memoryview(DECOMPRESS[compression.decode()](data))
        except (ValueError, KeyError) as error:
            raise BagError(f'{self._path}: the chunk at byte {start} is damaged: {error}') from None
        if len(data) != size:
            raise BagError(f'{self._path}: the chunk at byte {start} is truncated')
        if crc and start not in self._checked and zlib.crc32(data) != crc:
            raise BagError(f'{self._path}: the chunk at byte {start} is damaged: its checksum is wrong')
        self._checked.add(start)
        return data


def _gather(content: NDArray[np.uint8], starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Return a copy of ``size`` bytes at each of ``starts``, shape (n, size); all must be inside ``content``."""
    steps = np.diff(starts)
    if len(steps) and steps[0] > 0 and np.all(steps == steps[0]):
        # Equally spaced messages, as in a lockstep run, need only a view instead of indices.
        windows = np.lib.stride_tricks.sliding_window_view(content, size)
        copied: NDArray[np.uint8] = windows[starts[0] : starts[-1] + 1 : steps[0]].copy()
    else:
        copied = content[starts[:, None] + np.arange(size)]
    return copied


_BULK_READERS: dict[str, Callable[[Path, str, _Checked], Column]] = {'mcap': _read_mcap, 'sqlite3': _read_sqlite3}
