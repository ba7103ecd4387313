"""Writer of rosbag2 bags: MCAP in bulk by this package, sqlite3 through `rosbags`."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.tick_messages import Messages, TickMessages
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.mcap_bag import McapBag

STORAGES = ('mcap', 'sqlite3')
_BATCH_MESSAGES = 512
"""Number of messages that are written at once."""
FLUSH_INTERVAL = 0.1
"""Longest time that messages stay in this process before the next message triggers a flush [s]."""
FLUSH_TICKS = 512
"""Largest number of ticks that stay in this process, if ticks arrive a few at a time."""


class BagWriter:
    """
    Writer of serialized messages into a new bag.

    Messages are handed over to the operating system every :data:`FLUSH_INTERVAL` and every :data:`FLUSH_TICKS`, so that
    they survive the end of this process.

    Parameters
    ----------
    path
        Directory of the bag; it must not exist.
    storage
        ``mcap`` or ``sqlite3``.
    topics
        Absolute name, type name and offered queue depth of each topic; messages refer to a topic by its index here.
    metadata
        Strings stored in ``custom_data`` of the bag.
    options
        Compression and splitting.

    Raises
    ------
    ValueError
        If the storage is unknown or does not support the options.
    FileExistsError
        If the path exists; nothing is overwritten.
    OSError
        From any method, if the disk is full or fails. If possible, closing then still leaves a readable bag without the
        last messages.
    """

    def __init__(
        self,
        path: Path,
        storage: str,
        topics: Sequence[tuple[str, str, int]],
        metadata: dict[str, str],
        options: BagOptions = BagOptions(),  # noqa: B008 - a frozen value
    ) -> None:
        if storage not in STORAGES:
            raise ValueError(f'invalid value for parameter storage: {storage!r}; expected one of {", ".join(STORAGES)}')
        if path.exists():
            raise FileExistsError(f'{path} already exists')
        self._bag = _BAGS[storage](path, topics, metadata, options)
        self._topics: list[int] = []
        self._stamps: list[int] = []
        self._messages: list[bytes | memoryview] = []
        self._has_failed = False
        self._most_unflushed = FLUSH_TICKS * len(topics)
        self._unflushed = 0
        self._flushed_at = time.monotonic()

    def write(self, topics: Sequence[int], stamps: Sequence[int], messages: Sequence[bytes | memoryview]) -> None:
        """
        Write messages in order, each given by topic index, receive time [ns] and payload.

        Messages are queued until there are enough for a batch, which costs little more than the messages of one tick.

        Raises
        ------
        ValueError
            If the sequences have different lengths.
        """
        if not len(topics) == len(stamps) == len(messages):
            raise ValueError(f'{len(topics)} topics and {len(stamps)} stamps for {len(messages)} messages')
        self._topics += topics
        self._stamps += stamps
        self._messages += messages
        if len(self._messages) >= _BATCH_MESSAGES:
            self._write_queue()

    def flush(self) -> None:
        """Hand over all messages to the operating system, so that they survive the end of this process."""
        self._write_queue()
        self._flush_bag()

    def _flush_bag(self) -> None:
        self._unflushed, self._flushed_at = 0, time.monotonic()
        try:
            self._bag.flush()
        except OSError:
            self._has_failed = True
            raise

    def _flush_if_due(self, messages: int = 0) -> None:
        """Flush if, with ``messages`` new ones, too many are waiting, or if the last flush is too long ago."""
        self._unflushed += messages
        if self._unflushed >= self._most_unflushed or time.monotonic() - self._flushed_at >= FLUSH_INTERVAL:
            self._flush_bag()

    def _write_queue(self) -> None:
        if self._messages:
            topics, stamps, messages = self._topics, self._stamps, self._messages
            self._topics, self._stamps, self._messages = [], [], []
            sizes = np.array([len(message) for message in messages])
            self.write_batch(np.array(topics), np.array(stamps), sizes, memoryview(b''.join(messages)))

    def write_batch(
        self,
        topics: NDArray[np.integer],
        stamps: NDArray[np.integer],
        sizes: NDArray[np.integer],
        payloads: memoryview,
    ) -> None:
        """
        Write messages in order.

        Parameters
        ----------
        topics, stamps, sizes
            Index of the topic, receive time [ns] and size [bytes] of each message, shape (n,).
        payloads
            Concatenated messages.
        """
        self._write_queue()
        numbers = [array.astype(np.int64) for array in (topics, stamps, sizes)]
        kinds = _messages_per_tick(*numbers)
        try:
            if kinds:
                ticks = _BatchOfTicks(numbers[1][::kinds], numbers[2][:kinds], payloads)
                self._bag.write_ticks(numbers[0][:kinds].tolist(), ticks)
            else:
                self._bag.write_messages(*numbers, payloads)
        except OSError:
            self._has_failed = True
            raise
        self._flush_if_due(len(numbers[0]))

    def write_ticks(self, topics: Sequence[int], messages: TickMessages) -> None:
        """Write the messages of ticks, one per topic and tick, in the order of ``topics`` within each tick."""
        self._write_queue()
        try:
            self._bag.write_ticks(topics, messages)
        except OSError:
            self._has_failed = True
            raise
        # Ticks arrive by the thousand, so only the time counts.
        self._flush_if_due()

    def close(self) -> None:
        """Write the index and ``metadata.yaml``; the bag is then complete."""
        try:
            if not self._has_failed:
                self._write_queue()
        finally:
            self._bag.close()


def _messages_per_tick(topics: NDArray[np.int64], stamps: NDArray[np.int64], sizes: NDArray[np.int64]) -> int:
    """Return the number of messages per tick if all ticks have the same topics and sizes in order, otherwise 0."""
    again = np.flatnonzero(topics[1:] == topics[:1])
    if not len(again) or len(topics) % (again[0] + 1):
        return 0
    kinds = int(again[0]) + 1
    topics, stamps, sizes = (array.reshape(-1, kinds) for array in (topics, stamps, sizes))
    is_regular = np.all(topics == topics[0]) and np.all(sizes == sizes[0]) and np.all(stamps == stamps[:, :1])
    return kinds if is_regular else 0


class _BatchOfTicks:
    """Messages of consecutive ticks in one buffer."""

    def __init__(self, times: NDArray[np.int64], sizes: NDArray[np.int64], payloads: memoryview) -> None:
        self.times = times
        self.templates = [bytes(size) for size in sizes.tolist()]
        self._ends = np.cumsum(sizes).tolist()
        self._rows = np.frombuffer(payloads, dtype=np.uint8).reshape(len(times), -1)

    def fill(self, ticks: slice, payloads: Sequence[Messages]) -> None:
        """Copy the messages of some ticks."""
        for rows, end in zip(payloads, self._ends, strict=True):
            rows[:] = self._rows[ticks, end - rows.shape[1] : end]


def _sqlite3_bag(*arguments: Any) -> Any:
    # Imported only if needed: importing `rosbags` takes long, and most bags are MCAP.
    from hdd_servo_ros.recording.sqlite3_bag import Sqlite3Bag

    return Sqlite3Bag(*arguments)


_BAGS: dict[str, Any] = {'mcap': McapBag, 'sqlite3': _sqlite3_bag}
