"""
Rows of an sqlite3 bag read page by page, for a truncated or damaged file that SQLite cannot read.

A table is a tree of pages whose leaves contain the rows. In a file that grew row by row, the leaves of the first rows
come before the pages that point to them. See https://sqlite.org/fileformat.html, sections 1.6 and 2.
"""

import contextlib
import functools
import struct
from array import array
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from hdd_servo_ros.recording.sqlite_checksums import Checkpoint, Row, unpack

MAGIC, HEAD_SIZE = b'SQLite format 3\0', 100
_LEAF = 0x0D
_LEAF_HEAD = 8
_INTEGER_SIZES = {0: 0, 1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 8: 0, 9: 0}
_FIRST_BLOB = 12
_GROUP = 256
"""Number of pages that are read at once."""


def page_size(head: bytes) -> int:
    """Return the page size [bytes] in the header of a file; 0 if it is not the header of an sqlite3 file."""
    if len(head) < HEAD_SIZE or not head.startswith(MAGIC):
        return 0
    (size,) = struct.unpack_from('>H', head, 16)
    return 65536 if size == 1 else int(size)


class MessagePages:
    """
    Leaf pages with messages in a bag file, ordered by message id; only a few pages are in memory at once.

    Parameters
    ----------
    path
        Path of the file.

    Raises
    ------
    OSError
        If the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with path.open('rb') as file:
            head = file.read(HEAD_SIZE)
        self._size = page_size(head)
        self._usable = self._size - head[20] if self._size else 0

    def groups(self) -> Iterator[list[int]]:
        """Iterate over groups of leaf page numbers; all ids of a group are below those of the next group."""
        pages, firsts, lasts = array('q'), array('q'), array('q')
        for number, first, last in self._leaves():
            pages.append(number)
            firsts.append(first)
            lasts.append(last)
        group: list[int] = []
        highest = -1
        for index in sorted(range(len(pages)), key=firsts.__getitem__):
            if len(group) >= _GROUP and firsts[index] > highest:
                yield group
                group = []
            group.append(pages[index])
            highest = max(highest, lasts[index])
        if group:
            yield group

    def rows(self, group: Iterable[int]) -> list[Row]:
        """Return the messages on the leaf pages of a group, ordered by id."""
        rows: dict[int, Row] = {}
        with self._path.open('rb') as file:
            # If a row occurs twice, the later one in the file counts.
            for number in sorted(group):
                rows.update(_rows(self._page(file, number), self._usable, functools.partial(self._page, file)))
        return [rows[number] for number in sorted(rows)]

    def checkpoints(self) -> Iterator[Checkpoint]:
        """Iterate over the checkpoints of the table of checksums, in the order of the file."""
        if not self._size:
            return
        with self._path.open('rb') as file, self._path.open('rb') as others:
            other = functools.partial(self._page, others)
            while page := file.read(self._size):
                # The first page begins with the header of the file.
                if len(page) == self._size and page[0] == _LEAF and self._holds_checkpoints(memoryview(page), other):
                    yield from _checkpoints(memoryview(page), self._usable, other)

    def _holds_checkpoints(self, page: memoryview, other: Callable[[int], memoryview]) -> bool:
        """Return whether the first or the last readable row of a leaf page is a checkpoint."""
        return any(next(_checkpoints(page, self._usable, other, step), None) for step in (1, -1))

    def _page(self, file: BinaryIO, number: int) -> memoryview:
        """Return a page by its number, counted from 1; raise IndexError if the file does not contain all of it."""
        file.seek((number - 1) * self._size)
        page = file.read(self._size)
        if number < 1 or len(page) < self._size:
            raise IndexError(number)
        return memoryview(page)

    def _leaves(self) -> Iterator[tuple[int, int, int]]:
        """Iterate over the leaf pages with messages: page number, lowest and highest id."""
        if not self._size:
            return
        with self._path.open('rb') as file, self._path.open('rb') as others:
            number = 0
            while piece := file.read(self._size * _GROUP):
                for offset in range(0, len(piece) - self._size + 1, self._size):
                    number += 1
                    if number == 1 or piece[offset] != _LEAF:
                        continue
                    page = memoryview(piece)[offset : offset + self._size]
                    ends = [
                        next(_rows(page, self._usable, functools.partial(self._page, others), step), None)
                        for step in (1, -1)
                    ]
                    # Rows are ordered by id.
                    ids = [end[0] for end in ends if end is not None]
                    if ids:
                        yield number, min(ids), max(ids)


def _records(
    page: memoryview, usable: int, other: Callable[[int], memoryview], step: int = 1
) -> Iterator[tuple[int, bytes]]:
    """Iterate over ids and records of the rows on a leaf page, in reverse order if ``step`` is -1."""
    (count,) = struct.unpack_from('>H', page, 3)
    for offset in range(_LEAF_HEAD, min(_LEAF_HEAD + 2 * count, usable), 2)[::step]:
        # A row that cannot be read is damaged.
        with contextlib.suppress(IndexError, struct.error):
            (cell,) = struct.unpack_from('>H', page, offset)
            size, cell = _varint(page, cell)
            number, cell = _varint(page, cell)
            yield number, _payload(page, cell, size, usable, other)


def _rows(
    page: memoryview, usable: int, other: Callable[[int], memoryview], step: int = 1
) -> Iterator[tuple[int, Row]]:
    """Iterate over the messages on a leaf page with their ids, in reverse order if ``step`` is -1."""
    for number, record in _records(page, usable, other, step):
        # A row with other columns is of another table, or damaged.
        with contextlib.suppress(IndexError, KeyError):
            values = _values(record, 4)
            if values is not None:
                _, topic, time, payload = values
                yield number, (number, topic, time, payload)


def _checkpoints(
    page: memoryview, usable: int, other: Callable[[int], memoryview], step: int = 1
) -> Iterator[Checkpoint]:
    """Iterate over the checkpoints on a leaf page, in reverse order if ``step`` is -1."""
    for number, record in _records(page, usable, other, step):
        with contextlib.suppress(IndexError, KeyError):
            values = _values(record, 2)
            checkpoint = values and unpack(number, values[-1])
            if checkpoint:
                yield checkpoint


def _payload(page: memoryview, offset: int, size: int, usable: int, other: Callable[[int], memoryview]) -> bytes:
    most, least = usable - 35, (usable - 12) * 32 // 255 - 23
    if size <= most:
        return bytes(page[offset : offset + size])
    wanted = least + (size - least) % (usable - 4)
    local = wanted if wanted <= most else least
    payload = bytes(page[offset : offset + local])
    (following,) = struct.unpack_from('>I', page, offset + local)
    while following and len(payload) < size:
        page = other(following)
        payload += page[4 : 4 + min(usable - 4, size - len(payload))]
        (following,) = struct.unpack_from('>I', page)
    return payload


def _values(record: bytes, columns: int) -> tuple[Any, ...] | None:
    """Return the values of a row of integers whose last column is a blob; None if the row has other columns."""
    offset, kinds = 0, []
    head_size, offset = _varint(record, 0)
    while offset < head_size:
        kind, offset = _varint(record, offset)
        kinds.append(kind)
    if len(kinds) != columns or kinds[-1] < _FIRST_BLOB or kinds[-1] % 2:
        return None
    values: list[Any] = []
    for kind in kinds[:-1]:
        size = _INTEGER_SIZES[kind]
        values.append(int.from_bytes(record[offset : offset + size], 'big', signed=True) if size else int(kind == 9))
        offset += size
    end = offset + (kinds[-1] - _FIRST_BLOB) // 2
    return None if end != len(record) else (*values, record[offset:end])


def _varint(data: bytes | memoryview, offset: int) -> tuple[int, int]:
    """Return the variable-length integer at an offset, and the offset after it."""
    value = 0
    for count in range(8):
        byte = data[offset + count]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, offset + count + 1
    return value << 8 | data[offset + 8], offset + 9
