"""
Checksums of the messages of an sqlite3 bag, block by block, in a table of their own in the bag's file.

rosbag2 and rosbags query only the tables that they know, so they ignore this one. Each row of the table is a
checkpoint: the CRC-32 of each topic's messages up to an id, by :class:`hdd_servo_ros.recording.bag_digest.TopicDigest`.
Two consecutive checkpoints check the messages between them. If a checkpoint is lost, its two neighbors check both
blocks together.
"""

import bisect
import dataclasses
import struct
import zlib
from collections.abc import Iterable, Sequence

import numpy as np

from hdd_servo_ros.recording.bag_digest import TopicDigest

TABLE = 'hdd_servo_ros_checksums'
SCHEMA = f'CREATE TABLE {TABLE}(last_id INTEGER PRIMARY KEY, crc32s BLOB NOT NULL);'
INSERT = f'INSERT INTO {TABLE} VALUES (?, ?)'
SELECT = f'SELECT last_id, crc32s FROM {TABLE} ORDER BY last_id'
BLOCK_TICKS = 128
"""Most ticks in one block; a damaged value costs `recover` the whole block."""
_CRC = struct.Struct('<I')
_ID = struct.Struct('<q')
Row = tuple[int, int, int, bytes]
"""Id, topic id, receive time [ns] and payload of a message."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """
    Checksums of all messages up to one of them.

    Attributes
    ----------
    last_id
        Id of that message.
    states
        State of each topic's digest, by topic id from 1 on; see :attr:`TopicDigest.state`.
    """

    last_id: int
    states: tuple[tuple[int, int], ...]


def pack(last_id: int, digests: Sequence[TopicDigest]) -> bytes:
    """Return the content of a checkpoint's row: two CRC-32 per topic, then the CRC-32 of the row itself."""
    states = [number for digest in digests for number in digest.state]
    content = struct.pack(f'<{len(states)}I', *states)
    return content + _CRC.pack(zlib.crc32(_ID.pack(last_id) + content))


def unpack(last_id: object, content: object) -> Checkpoint | None:
    """Return the checkpoint in a row of the table; None if the row is damaged."""
    if not isinstance(last_id, int) or not isinstance(content, bytes) or len(content) % 8 != _CRC.size:
        return None
    states, crc = content[: -_CRC.size], content[-_CRC.size :]
    if not -(2**63) <= last_id < 2**63 or _CRC.pack(zlib.crc32(_ID.pack(last_id) + states)) != crc:
        return None
    return Checkpoint(last_id, tuple(struct.iter_unpack('<II', states)))


class BlockCheck:
    """
    Check of a file's messages against its checkpoints.

    Parameters
    ----------
    checkpoints
        In any order.
    closing
        State of each topic's digest after the last message of the bag, by ``metadata.yaml``; None if it is not known.
    """

    def __init__(self, checkpoints: Iterable[Checkpoint], closing: tuple[tuple[int, int], ...] | None = None) -> None:
        self._checkpoints = sorted(checkpoints, key=lambda checkpoint: checkpoint.last_id)
        self._closing = closing
        self._next = 0
        self._digests: dict[int, TopicDigest] = {}
        self._begin = self._last = 0
        """Ids of the last message that is in a block already looked at, and of the last message given."""
        self.wrong: list[tuple[int, int]] = []
        """First and last id of each block whose messages do not match, in ascending order."""

    def add(self, rows: Sequence[Row]) -> None:
        """Add the next messages, ordered by id."""
        ids = [row[0] for row in rows]
        start = 0
        while start < len(rows):
            end = len(rows)
            if self._next < len(self._checkpoints):
                end = bisect.bisect_right(ids, self._checkpoints[self._next].last_id, start)
            self._digest(rows[start:end])
            if end < len(rows):
                self._end_block(self._checkpoints[self._next])
            start = end

    def _digest(self, rows: Sequence[Row]) -> None:
        by_topic: dict[int, tuple[list[int], list[bytes]]] = {}
        for number, topic, time, payload in rows:
            times, payloads = by_topic.setdefault(topic, ([], []))
            times.append(time)
            payloads.append(payload)
            self._last = number
        for topic, (times, payloads) in by_topic.items():
            digest = self._digests.setdefault(topic, TopicDigest())
            digest.add(np.array(times, dtype=np.int64), b''.join(payloads))

    def _matches(self, states: tuple[tuple[int, int], ...]) -> bool:
        known = range(1, len(states) + 1)
        return all(topic in known for topic in self._digests) and all(
            self._digests.get(topic, TopicDigest()).state == state for topic, state in zip(known, states, strict=True)
        )

    def _end_block(self, checkpoint: Checkpoint) -> None:
        if not self._matches(checkpoint.states):
            self.wrong.append((self._begin + 1, checkpoint.last_id))
        self._digests = {topic: TopicDigest(*state) for topic, state in enumerate(checkpoint.states, 1)}
        self._begin = checkpoint.last_id
        self._next += 1

    def finish(self) -> None:
        """Add the block of the last messages, which counts as wrong if no checkpoint follows it."""
        if self._next < len(self._checkpoints) and self._last > self._begin:
            # If messages before the checkpoint are missing, the others of the block cannot be checked.
            is_right = self._matches(self._checkpoints[self._next].states)
        else:
            is_right = self._last <= self._begin or (self._closing is not None and self._matches(self._closing))
        if not is_right:
            self.wrong.append((self._begin + 1, self._last))


def is_in(number: int, blocks: Sequence[tuple[int, int]]) -> bool:
    """Return whether an id is in one of the blocks, given by their first and last ids in ascending order."""
    index = bisect.bisect_right(blocks, (number, 2**63))
    return index > 0 and number <= blocks[index - 1][1]
