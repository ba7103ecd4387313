"""Complete messages of a bag file that was never closed or is truncated, read from the start without its index."""

import contextlib
import dataclasses
import functools
import itertools
import mmap
import os
import shutil
import sqlite3
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from hdd_servo_ros.recording.bag_digest import digest_state
from hdd_servo_ros.recording.bag_metadata import MetadataError, read_metadata
from hdd_servo_ros.recording.chunk_compression import DECOMPRESS, DECOMPRESS_BEGINNING
from hdd_servo_ros.recording.salvaged_messages import Message, SalvagedMessages
from hdd_servo_ros.recording.sqlite_checksums import (
    SELECT,
    TABLE,
    BlockCheck,
    Checkpoint,
    Row,
    is_in,
    unpack,
)
from hdd_servo_ros.recording.sqlite_pages import HEAD_SIZE, MessagePages, page_size
from hdd_servo_ros.recording.sqlite_topics import is_message, topics_of

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_RECORD = struct.Struct('<BQ')
_CHUNK_HEAD = struct.Struct('<QQQI')
_MESSAGE_HEAD = struct.Struct('<HIQQ')
_PAGE_COUNT = 28
"""Offset of the number of pages in the header of an sqlite3 file."""
STORAGE_BY_ENDING = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_ROWS = 'SELECT id, topic_id, timestamp, data FROM messages NOT INDEXED'
_ROWS_AT_ONCE = 2**13
_BEGINNING = 2**20
"""Bytes at the beginning of an sqlite3 file that contain the table of topics."""
_Blocks = Sequence[tuple[int, int]]
"""First and last id of each block of messages."""
_SQLITE_COMPANIONS = ('-journal', '-wal', '-shm')


@dataclasses.dataclass
class Salvage:
    """
    Messages that could be read from a file.

    Attributes
    ----------
    types
        Type of each topic, by its full name.
    messages
        Topic, receive time [ns] and payload of every complete message, in the file's order.
    fault
        Where and why reading ended before the regular end of the file; empty if the file is intact.
    unknown
        Content that this package cannot read although it may be intact, such as an unsupported compression; empty if
        everything can be read.
    is_checked
        Whether a checksum covers every message, that of its chunk (MCAP) or its block (sqlite3).
    """

    types: dict[str, str] = dataclasses.field(default_factory=dict)
    messages: SalvagedMessages = dataclasses.field(default_factory=SalvagedMessages)
    fault: str = ''
    unknown: str = ''
    is_checked: bool = True


def salvage(path: Path) -> Salvage:
    """
    Read as much as possible of a bag file, MCAP or sqlite3 by its ending.

    Raises
    ------
    OSError
        If the file cannot be read at all.
    """
    return _SqliteSalvage(path).found if path.suffix == '.db3' else _McapSalvage(path).found


def complete_ticks(messages: Iterable[tuple[str, int, bytes]], topics: Sequence[str], step: int) -> int:
    """
    Return how many ticks from tick 0 on are complete.

    Parameters
    ----------
    messages
        Topic, receive time [ns] and payload of each, in the order of the file.
    topics
        Full names of the topics that have a message at every tick.
    step
        T [ns].
    """
    counts = dict.fromkeys(topics, 0)
    for topic, time, _ in messages:
        # A message of any other than the next tick ends the contiguous part.
        if topic in counts and time == counts[topic] * step:
            counts[topic] += 1
    return min(counts.values(), default=0)


def bag_files(bag: Path) -> list[Path]:
    """Return the files of a bag in the order in which they were written."""
    files = [path for ending in STORAGE_BY_ENDING for path in bag.glob(f'*{ending}')]
    # bag_2 comes before bag_10, so shorter names come first.
    return sorted(files, key=lambda path: (list(STORAGE_BY_ENDING).index(path.suffix), len(path.name), path.name))


def last_tick_of(bag: Path, topics: Sequence[str], step: int) -> int:
    """
    Return the last complete tick that can be recovered from a bag; -1 if no tick is complete.

    Parameters
    ----------
    bag
        Directory of the bag.
    topics, step
        See :func:`complete_ticks`.

    Raises
    ------
    OSError
        If a file cannot be read at all.
    """
    messages = itertools.chain.from_iterable(salvage(file).messages for file in bag_files(bag))
    return complete_ticks(messages, topics, step) - 1


class _Fault(Exception):
    """A record from which on the file cannot be interpreted."""


class _McapSalvage:
    """Reader of the data section of an MCAP file, which contains everything; see https://mcap.dev/spec."""

    def __init__(self, path: Path) -> None:
        self.found = Salvage()
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, str] = {}
        self._path = path
        with path.open('rb') as file:
            self._size = os.fstat(file.fileno()).st_size
            self._content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if self._size else None
        self._dropped = 0
        data = memoryview(self._content or b'')
        try:
            if data[:8] != _MAGIC:
                raise _Fault('the file does not begin as an MCAP file does')
            if not self._walk(data[8:], 8):
                raise _Fault(f'truncated after byte {self._size}: the index is missing')
            if data[-8:] != _MAGIC:
                raise _Fault('the index is truncated')
        except _Fault as fault:
            self.found.fault = str(fault)
        # Messages that are read again open the file again; the mapping would keep it open.
        self._content = None

    def _walk(self, data: memoryview, first: int, *, in_chunk: bool = False) -> bool:
        """
        Read a sequence of records; return whether it includes the end of the data section.

        Parameters
        ----------
        data
            Records of the file or of a chunk.
        first
            Byte of the file at which they begin.
        in_chunk
            Whether the records are those of a chunk.
        """
        offset = 0
        while offset < len(data):
            start = first + offset
            if len(data) - offset < _RECORD.size:
                raise self._cut_off(start, first + len(data))
            opcode, size = _RECORD.unpack_from(data, offset)
            offset += _RECORD.size
            if opcode in (_DATA_END, _FOOTER):
                return True
            if not 0 < opcode < 0x80 or opcode > _DATA_END:
                self._discard_last()
                raise _Fault(f'no record at byte {start}')
            content = data[offset : offset + size]
            if opcode == _CHUNK:
                self._take_chunk(content, size, start)
            elif len(content) < size:
                raise self._cut_off(start, first + len(data))
            else:
                # The checksum of a chunk covers the messages in it.
                self.found.is_checked &= opcode != _MESSAGE or in_chunk
                self._take(opcode, content)
            offset += size
        return False

    def _cut_off(self, start: int, end: int) -> _Fault:
        """Return the fault of a record that begins at byte ``start`` and extends beyond byte ``end``."""
        if end == self._size:
            return _Fault(f'truncated at byte {end}, within the record that begins at byte {start}')
        return _Fault(f'the record at byte {start} goes beyond the end of its chunk at byte {end}')

    def _take(self, opcode: int, content: memoryview) -> None:
        try:
            if opcode == _MESSAGE:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(content)
                self.found.messages.append((self._channels[channel], time, bytes(content[_MESSAGE_HEAD.size :])))
            elif opcode == _SCHEMA:
                self._schemas[struct.unpack_from('<H', content)[0]] = _text(content, 2)
            elif opcode == _CHANNEL:
                channel, schema = struct.unpack_from('<HH', content)
                topic = self._channels[channel] = _text(content, 4)
                self.found.types[topic] = self._schemas[schema]
        except (struct.error, KeyError, UnicodeDecodeError):
            raise _Fault(f'a record with opcode {opcode} is invalid') from None

    def _take_chunk(self, content: memoryview, size: int, start: int) -> None:
        """Read the chunk that begins at byte ``start``; of a truncated chunk, the part that is left."""
        if len(content) < _CHUNK_HEAD.size + 12:
            raise _Fault(f'truncated at byte {self._size}, within the header of the chunk that begins at byte {start}')
        _, _, _, checksum = _CHUNK_HEAD.unpack_from(content)
        compression = _text(content, _CHUNK_HEAD.size)
        if compression not in DECOMPRESS:
            self.found.unknown = f'the chunk at byte {start} uses the unsupported compression {compression!r:.40}'
            raise _Fault(self.found.unknown)
        records = content[_CHUNK_HEAD.size + 12 + len(compression) :]
        first = start + _RECORD.size + _CHUNK_HEAD.size + 12
        is_whole = len(content) == size
        self.found.is_checked &= checksum != 0
        if compression:
            records, first = self._decompressed(records, compression, start, is_whole=is_whole), start
        if is_whole and checksum and zlib.crc32(records) != checksum:
            raise _Fault(f'the chunk at byte {start} is damaged: its checksum is wrong')
        self.found.messages.begin()
        if compression and not is_whole:
            # The last complete block of the compression ends within a record.
            with contextlib.suppress(_Fault):
                self._walk(records, first, in_chunk=True)
        else:
            self._walk(records, first, in_chunk=True)
        if not is_whole:
            raise _Fault(f'truncated at byte {self._size}, within the chunk that begins at byte {start}')
        self.found.messages.store(functools.partial(self._read_again, start, _RECORD.size + size, compression))
        self._drop(start)

    def _drop(self, end: int) -> None:
        """Release the memory of the part of the file before byte ``end``."""
        page = end - end % mmap.PAGESIZE
        if self._content is not None and page > self._dropped and hasattr(self._content, 'madvise'):
            self._content.madvise(mmap.MADV_DONTNEED, self._dropped, page - self._dropped)
            self._dropped = page

    def _read_again(self, start: int, size: int, compression: str) -> list[Message]:
        """Return the messages of the chunk at byte ``start``, which is known to be intact."""
        with self._path.open('rb') as file:
            file.seek(start)
            chunk = memoryview(file.read(size))[_RECORD.size :]
        records = memoryview(DECOMPRESS[compression](chunk[_CHUNK_HEAD.size + 12 + len(compression) :]))
        messages, offset = [], 0
        while offset < len(records):
            opcode, length = _RECORD.unpack_from(records, offset)
            offset += _RECORD.size
            if opcode == _MESSAGE:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(records, offset)
                payload = bytes(records[offset + _MESSAGE_HEAD.size : offset + length])
                messages.append((self._channels[channel], time, payload))
            offset += length
        return messages

    @staticmethod
    def _decompressed(records: memoryview, compression: str, start: int, *, is_whole: bool) -> memoryview:
        """Return the records of the compressed chunk at byte ``start`` that can be recovered."""
        try:
            if is_whole:
                return memoryview(DECOMPRESS[compression](records))
            # Zeros left by a power failure are removed, so that the block in which they begin is incomplete.
            return memoryview(DECOMPRESS_BEGINNING[compression](bytes(records).rstrip(b'\x00')))
        except ValueError as error:
            raise _Fault(f'the chunk at byte {start} is damaged: {error}') from None

    def _discard_last(self) -> None:
        """Discard the message before a gap: zeros left by a power failure may begin within it."""
        if self.found.messages:
            self.found.messages.pop()


def _text(content: memoryview, start: int) -> str:
    (length,) = struct.unpack_from('<I', content, start)
    return bytes(content[start + 4 : start + 4 + length]).decode()


_UNCHECKED = 'the file has no checksums per block, so changed values before that cannot be detected'


class _SqliteSalvage:
    """
    Reader of a database in place; one with a journal is copied first, because SQLite changes the file to replay it.

    SQLite does not open a file that is shorter than its header states. Its rows are then read page by page.
    """

    def __init__(self, path: Path) -> None:
        self.found = Salvage()
        self._names: dict[int, str] = {}
        self._folder = path.parent
        self._path, self._address = path, f'{path.resolve().as_uri()}?mode=ro&immutable=1'
        companions = [path.with_name(path.name + ending) for ending in _SQLITE_COMPANIONS]
        if any(companion.exists() for companion in companions):
            self._copy([path, *filter(Path.exists, companions)])
        self._has_checksums = _declares_checksums(self._path)
        self._faults: list[str] = []
        missing = _missing_pages(self._path)
        if missing:
            self._read_beginning()
            self._take_pages()
            self._faults.insert(0, f'the database can be read up to message {len(self.found.messages)}: {missing}')
        else:
            self._take_database()
        self.found.is_checked = self._has_checksums
        self.found.fault = '; '.join(self._faults)

    def _take_database(self) -> None:
        try:
            with self._connection() as connection:
                self._read_topics(connection)
                self._take_rows(connection)
        except sqlite3.Error as error:
            if not self._names:
                self._read_beginning()
            self._take_pages()
            fault = f'the database can be read up to message {len(self.found.messages)}: {error}'
            self._faults.insert(0, fault if self._has_checksums else f'{fault}; {_UNCHECKED}')

    def _copy(self, files: Sequence[Path]) -> None:
        """Work on a copy that exists as long as this object."""
        self._directory = tempfile.TemporaryDirectory()
        for file in files:
            shutil.copyfile(file, Path(self._directory.name) / file.name)
        self._path = Path(self._directory.name) / self._path.name
        self._address = self._path.as_uri()

    @contextlib.contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        with contextlib.closing(sqlite3.connect(self._address, uri=True)) as connection:
            yield connection

    def _read_topics(self, connection: sqlite3.Connection) -> None:
        topics = topics_of(connection, self._folder)
        self._names = {number: name for number, (name, _) in topics.items()}
        self.found.types = dict(topics.values())

    def _read_beginning(self) -> None:
        """Read the topics from a copy of the first pages, which were written before the first message."""
        with tempfile.TemporaryDirectory() as directory:
            copy = Path(directory) / self._path.name
            with self._path.open('rb') as file:
                copy.write_bytes(file.read(_BEGINNING))
            _correct_page_count(copy)
            with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(copy)) as connection:
                self._read_topics(connection)

    def _take_rows(self, connection: sqlite3.Connection) -> None:
        """Take the rows that SQLite finds, ordered by id as they were written; the index on the time may be damaged."""
        wrong_blocks = self._wrong_blocks(_parts_of(connection), functools.partial(_checkpoints_of, connection))
        wrong: list[int] = []
        for part in _parts_of(connection):
            wrong += [row for row, *message in part if not self._is_message(message)]
            read = functools.partial(self._read_rows, part[0][0], part[-1][0], wrong_blocks)
            self._take(part, wrong_blocks, read)
        if wrong:
            self._faults.append(f'rows that are not messages: {len(wrong)}, the first is row {wrong[0]}')

    def _is_message(self, row: Sequence[object]) -> bool:
        topic, time, payload = row
        return topic in self._names and is_message(time, payload)

    def _read_rows(self, first: int, last: int, wrong_blocks: _Blocks) -> list[Message]:
        with self._connection() as connection:
            rows = connection.execute(f'{_ROWS} WHERE id BETWEEN ? AND ? ORDER BY id', (first, last))
            return self._messages(rows, wrong_blocks)

    def _take_pages(self) -> None:
        """Take the rows on the pages, if they are more than those that SQLite finds."""
        by_sqlite, self.found.messages = self.found.messages, SalvagedMessages()
        faults, self._faults = self._faults, []
        pages = MessagePages(self._path)
        wrong_blocks = self._wrong_blocks(map(pages.rows, pages.groups()), pages.checkpoints)
        for group in pages.groups():
            self._take(pages.rows(group), wrong_blocks, functools.partial(self._read_pages, pages, group, wrong_blocks))
        if len(self.found.messages) <= len(by_sqlite):
            self.found.messages, self._faults = by_sqlite, faults

    def _read_pages(self, pages: MessagePages, group: Sequence[int], wrong_blocks: _Blocks) -> list[Message]:
        return self._messages(pages.rows(group), wrong_blocks)

    def _wrong_blocks(
        self, parts: Iterable[Sequence[Row]], read_checkpoints: Callable[[], Iterable[Checkpoint]]
    ) -> _Blocks:
        """Return the blocks of messages that do not match their checksums; none for a file without checksums."""
        checkpoints: list[Checkpoint] = []
        # Of a damaged table of checksums, the rows before the damage are used.
        with contextlib.suppress(sqlite3.Error):
            checkpoints += read_checkpoints()
        self._has_checksums |= bool(checkpoints)
        if not self._has_checksums:
            return []
        check = BlockCheck(checkpoints, self._closing_digests())
        # Reading ends at a damaged page; the rows before it are checked.
        with contextlib.suppress(sqlite3.Error):
            for part in parts:
                check.add([row for row in part if is_message(*row[2:])])
        check.finish()
        if len(check.wrong) == 1:
            first, last = check.wrong[0]
            self._faults.append(f'rows {first} to {last} do not match their checksum and are left out')
        elif check.wrong:
            blocks = f'{len(check.wrong)} blocks between rows {check.wrong[0][0]} and {check.wrong[-1][1]}'
            self._faults.append(f'{blocks} do not match their checksums and are left out')
        return check.wrong

    def _closing_digests(self) -> tuple[tuple[int, int], ...] | None:
        """Return the state of each topic's digest at the end of the bag, by its metadata."""
        try:
            metadata = read_metadata(self._folder)
        except (OSError, MetadataError):
            return None
        states = [digest_state(metadata.digests.get(topic, '')) for topic in metadata.types]
        return None if len(metadata.files) != 1 or None in states else tuple(filter(None, states))

    def _take(self, rows: Iterable[Row], wrong_blocks: _Blocks, read: Callable[[], list[Message]]) -> None:
        self.found.messages.begin()
        for message in self._messages(rows, wrong_blocks):
            self.found.messages.append(message)
        self.found.messages.store(read)

    def _messages(self, rows: Iterable[Row], wrong_blocks: _Blocks) -> list[Message]:
        if wrong_blocks:
            rows = (row for row in rows if not is_in(row[0], wrong_blocks))
        return [(self._names[row[1]], row[2], row[3]) for row in rows if self._is_message(row[1:])]


def _parts_of(connection: sqlite3.Connection) -> Iterator[list[Row]]:
    """Iterate over the rows of a database, some thousand at once."""
    rows = connection.execute(f'{_ROWS} ORDER BY id')
    while part := rows.fetchmany(_ROWS_AT_ONCE):
        yield part


def _checkpoints_of(connection: sqlite3.Connection) -> Iterator[Checkpoint]:
    """Iterate over the checkpoints of a database."""
    for last_id, content in connection.execute(SELECT):
        checkpoint = unpack(last_id, content)
        if checkpoint is not None:
            yield checkpoint


def _declares_checksums(path: Path) -> bool:
    """Return whether the first page of a database, which lists its tables, names that of the checksums."""
    with path.open('rb') as file:
        size = page_size(file.read(HEAD_SIZE))
        file.seek(0)
        return TABLE.encode() in file.read(size)


def _missing_pages(path: Path) -> str:
    """Return a description of the pages that a database lacks according to its header; empty if it is complete."""
    with path.open('rb') as file:
        head = file.read(HEAD_SIZE)
    size = page_size(head)
    if not size:
        return ''
    (claimed,) = struct.unpack_from('>I', head, _PAGE_COUNT)
    present = path.stat().st_size // size
    return f'it has {present} of {claimed} pages' if present < claimed else ''


def _correct_page_count(path: Path) -> None:
    """Set the page count in the header of a database to the number of pages left; SQLite rejects a larger count."""
    with path.open('r+b') as file:
        size = page_size(file.read(HEAD_SIZE))
        if size:
            file.seek(_PAGE_COUNT)
            file.write(struct.pack('>I', path.stat().st_size // size))
