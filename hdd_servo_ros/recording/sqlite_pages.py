"""
Rows of an sqlite3 bag read page by page, where SQLite finds no way to them because the file is cut off.

A table is a tree of pages whose leaves hold the rows; of a file that grew by a row at a time, the leaves of the first
rows lie in front of the pages that point at them. See https://sqlite.org/fileformat.html, 1.6 and 2.
"""

import contextlib
import struct
from collections.abc import Iterator, Sequence

MAGIC, HEAD_SIZE = b'SQLite format 3\0', 100
_LEAF = 0x0D
_LEAF_HEAD = 8
_INTEGER_SIZES = {0: 0, 1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 8: 0, 9: 0}
_FIRST_BLOB = 12


def page_size(head: bytes) -> int:
    """Return how many bytes a page has, by the head of the file; 0 if it is no head of an sqlite3 file."""
    if len(head) < HEAD_SIZE or not head.startswith(MAGIC):
        return 0
    (size,) = struct.unpack_from('>H', head, 16)
    return 65536 if size == 1 else int(size)


def message_rows(content: bytes) -> list[tuple[int, int, bytes]]:
    """Return topic id, time [ns] and payload of every row on the whole pages of a bag, in the order of their ids."""
    size = page_size(content[:HEAD_SIZE])
    if not size:
        return []
    usable = size - content[20]
    pages = [memoryview(content)[place : place + size] for place in range(0, len(content) - size + 1, size)]
    rows: dict[int, tuple[int, int, bytes]] = {}
    for page in pages[1:]:
        if page[0] == _LEAF:
            rows.update(_rows(page, usable, pages))
    return [rows[number] for number in sorted(rows)]


def _rows(page: memoryview, usable: int, pages: Sequence[memoryview]) -> Iterator[tuple[int, tuple[int, int, bytes]]]:
    (count,) = struct.unpack_from('>H', page, 3)
    for place in range(_LEAF_HEAD, min(_LEAF_HEAD + 2 * count, usable), 2):
        # What makes no sense is another table's row, or damaged.
        with contextlib.suppress(IndexError, KeyError, struct.error):
            (cell,) = struct.unpack_from('>H', page, place)
            size, cell = _varint(page, cell)
            number, cell = _varint(page, cell)
            row = _message(_payload(page, cell, size, usable, pages))
            if row is not None:
                yield number, row


def _payload(page: memoryview, place: int, size: int, usable: int, pages: Sequence[memoryview]) -> bytes:
    most, least = usable - 35, (usable - 12) * 32 // 255 - 23
    if size <= most:
        return bytes(page[place : place + size])
    wanted = least + (size - least) % (usable - 4)
    local = wanted if wanted <= most else least
    payload = bytes(page[place : place + local])
    (following,) = struct.unpack_from('>I', page, place + local)
    while following and len(payload) < size:
        page = pages[following - 1]
        payload += page[4 : 4 + min(usable - 4, size - len(payload))]
        (following,) = struct.unpack_from('>I', page)
    return payload


def _message(record: bytes) -> tuple[int, int, bytes] | None:
    """Return what a row of `messages` (id, topic_id, timestamp, data) holds, None if it is no such row."""
    place, kinds = 0, []
    head_size, place = _varint(record, 0)
    while place < head_size:
        kind, place = _varint(record, place)
        kinds.append(kind)
    if len(kinds) != 4 or kinds[3] < _FIRST_BLOB or kinds[3] % 2:
        return None
    values = []
    for kind in kinds[:3]:
        size = _INTEGER_SIZES[kind]
        values.append(int.from_bytes(record[place : place + size], 'big', signed=True) if size else int(kind == 9))
        place += size
    end = place + (kinds[3] - _FIRST_BLOB) // 2
    return None if end != len(record) else (values[1], values[2], record[place:end])


def _varint(data: bytes | memoryview, place: int) -> tuple[int, int]:
    """Return the number at a place, and the place behind it."""
    value = 0
    for count in range(8):
        byte = data[place + count]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + count + 1
    return value << 8 | data[place + 8], place + 9
