"""Writer of rosbag2 bags in sqlite3, based on `rosbags`, with the metadata that `ros2 bag info` of Jazzy reads."""

import contextlib
import copy
import dataclasses
import errno
import os
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.messages.tick_messages import TickMessages
from hdd_servo_ros.recording.bag_digest import DIGEST_KEY, TopicDigest, write_digests
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.disk import Reserve, sync_folder, write_durably
from hdd_servo_ros.recording.sqlite_checksums import BLOCK_TICKS, INSERT, SCHEMA, pack

_WRITTEN_BY = 'ros_distro: rosbags'
_DISTRIBUTION = 'ros_distro: jazzy'
_RESERVE = 2**20
"""Disk space reserved for closing a bag: the metadata, twice, and pages of the database [bytes]."""
_FOREVER = QosTime(9223372036, 854775807)


class _JazzySqlite3Writer(Sqlite3Writer):
    SQLITE_SCHEMA = (
        # A commit survives the end of this process at once, and a power failure as soon as the system has written it.
        # Waiting for the disk at every commit would take longer than writing the rows.
        'PRAGMA synchronous = OFF;' + Sqlite3Writer.SQLITE_SCHEMA.replace("'rosbags'", "'jazzy'") + SCHEMA
    )

    def close(self, version: int, metadata: str) -> None:
        super().close(version, metadata.replace(_WRITTEN_BY, _DISTRIBUTION))


class _JazzyWriter(Writer):
    """Writer of `rosbags` with Jazzy as the distribution, because message definitions and hashes are those of Jazzy."""

    STORAGE_PLUGINS = MappingProxyType({StoragePlugin.SQLITE3: _JazzySqlite3Writer})

    def close(self) -> None:
        super().close()
        text = self.metapath.read_text('utf8').replace(_WRITTEN_BY, _DISTRIBUTION)
        write_durably(self.metapath, text, self.metapath.with_suffix('.yaml.tmp'))
        sync_folder(self.path.parent)

    @property
    def database(self) -> sqlite3.Connection:
        """Connection to the database."""
        assert isinstance(self.storage, _JazzySqlite3Writer)
        return self.storage.conn

    @property
    def last_id(self) -> int:
        """Id of the last message."""
        assert isinstance(self.storage, _JazzySqlite3Writer)
        return self.storage.cursor.lastrowid or 0


@dataclasses.dataclass(frozen=True)
class _Committed:
    """State of the bag at a commit: counts by topic, first and last time [ns], and digests."""

    counts: dict[int, int]
    times: tuple[int, int]
    digests: tuple[TopicDigest, ...]


def _offered_qos(depth: int) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


class Sqlite3Bag:
    """Writer of an sqlite3 bag; see :class:`hdd_servo_ros.recording.bag_writer.BagWriter` for the parameters."""

    def __init__(
        self, path: Path, topics: Sequence[tuple[str, str, int]], metadata: dict[str, str], options: BagOptions
    ) -> None:
        if options != BagOptions():
            raise ValueError(f'storage = sqlite3 does not support {options}; use storage = mcap')
        self._file = path / f'{path.name}.db3'
        self._committed: _Committed | None = None
        self._writer = _JazzyWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        for key, text in metadata.items():
            self._writer.set_custom_data(key, text)
        with self._os_errors():
            self._writer.open()
        self._reserve = Reserve(path / 'reserve.tmp')
        self._digests = {name: TopicDigest() for name, _, _ in topics}
        self._digest_of = list(self._digests.values())
        types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: list[Connection] = [
            self._writer.add_connection(name, type_name, typestore=types, offered_qos_profiles=(_offered_qos(depth),))
            for name, type_name, depth in topics
        ]
        self._committed = self._state()
        try:
            self._reserve.grow(_RESERVE)
            self.flush()
        except OSError:
            self._reserve.release()
            raise

    def _state(self) -> _Committed:
        times = self._writer.min_timestamp, self._writer.max_timestamp
        return _Committed(dict(self._writer.counts), times, tuple(map(copy.copy, self._digest_of)))

    @contextlib.contextmanager
    def _os_errors(self) -> Iterator[None]:
        """Convert an error of SQLite to an OSError."""
        try:
            yield
        except sqlite3.OperationalError as error:
            # In Python 3.10 the error has no number.
            full = 'full' in str(error)
            # SQLite may have rolled back the transaction already.
            with contextlib.suppress(sqlite3.Error):
                self._roll_back()
            number = errno.ENOSPC if full else errno.EIO
            raise OSError(number, os.strerror(number) if full else str(error), str(self._file)) from None

    def flush(self) -> None:
        """Commit all messages, so that they survive the end of this process."""
        with self._os_errors():
            self._writer.database.commit()
        self._committed = self._state()

    def _roll_back(self) -> None:
        """Return to the state of the last commit."""
        if self._committed is None:
            return
        self._writer.database.rollback()
        self._writer.counts.clear()
        self._writer.counts.update(self._committed.counts)
        self._writer.min_timestamp, self._writer.max_timestamp = self._committed.times
        for digest, committed in zip(self._digest_of, self._committed.digests, strict=True):
            digest.__dict__.update(committed.__dict__)

    def write_ticks(self, topics: Sequence[int], messages: TickMessages) -> None:
        """Write the messages of ticks, one per topic and tick, in the order of ``topics`` within each tick."""
        count = len(messages.times)
        payloads = [np.tile(np.frombuffer(template, np.uint8), (count, 1)) for template in messages.templates]
        messages.fill(slice(0, count), payloads)
        for first in range(0, count, BLOCK_TICKS):
            block = slice(first, first + BLOCK_TICKS)
            self._write_block(topics, messages.times[block], [rows[block] for rows in payloads])

    def _write_block(
        self, topics: Sequence[int], times: NDArray[np.int64], payloads: Sequence[NDArray[np.uint8]]
    ) -> None:
        write, connections = self._writer.write, [self._connections[topic] for topic in topics]
        with self._os_errors():
            for tick, time in enumerate(times.tolist()):
                for connection, rows in zip(connections, payloads, strict=True):
                    write(connection, time, rows[tick].data)
            for topic, rows in zip(topics, payloads, strict=True):
                self._digest_of[topic].add(times, rows)
            self._add_checkpoint()

    def _add_checkpoint(self) -> None:
        """Write the digests of all topics up to the last message."""
        last_id = self._writer.last_id
        self._writer.database.execute(INSERT, (last_id, pack(last_id, self._digest_of)))

    def write_messages(
        self, topics: NDArray[np.int64], times: NDArray[np.int64], sizes: NDArray[np.int64], payloads: memoryview
    ) -> None:
        """Write messages, given by topic, time [ns] and size [bytes] of each, and by their concatenation."""
        ends = np.cumsum(sizes)
        numbers = (topics.tolist(), times.tolist(), (ends - sizes).tolist(), ends.tolist())
        with self._os_errors():
            for topic, time, start, end in zip(*numbers, strict=True):
                self._writer.write(self._connections[topic], time, payloads[start:end])
            for topic in np.unique(topics).tolist():
                own = np.flatnonzero(topics == topic)
                parts = [payloads[start:end] for start, end in zip(ends[own] - sizes[own], ends[own], strict=True)]
                self._digest_of[topic].add(times[own], b''.join(parts))
            self._add_checkpoint()

    def close(self) -> None:
        """Write the index and ``metadata.yaml``, with the digests of the topics."""
        try:
            self.flush()
        finally:
            self._reserve.release()
            self._writer.set_custom_data(DIGEST_KEY, write_digests(self._digests))
            with self._os_errors():
                self._writer.close()
