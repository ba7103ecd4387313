"""Bulk writer of rosbag2 bags with one or more MCAP files."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.tick_messages import TickMessages
from hdd_servo_ros.messages.ticks import NANOSECONDS
from hdd_servo_ros.parameters import InvalidParameterError
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.bag_topics import BagTopic, bag_topics, to_yaml
from hdd_servo_ros.recording.disk import Reserve, sync_folder, write_durably
from hdd_servo_ros.recording.mcap_writer import Channel, McapWriter
from hdd_servo_ros.recording.zstd import require_zstd
from hdd_servo_ros.version import __version__

_VERSION = 9
"""Version of the rosbag2 format."""
_TICKS_BETWEEN_SPLITS = 512
"""Number of ticks between checks of the file size."""
_RESERVE_STEP = 2**18
"""Step of the disk space reserved for closing a bag [bytes]; enough for a bag without chunks."""
_NO_TIMES = 2**63 - 1, 0
"""First and last time that rosbag2 writes for a bag without messages."""


class McapBag:
    """Writer of an MCAP bag; see :class:`hdd_servo_ros.recording.bag_writer.BagWriter` for the parameters."""

    def __init__(
        self, path: Path, topics: Sequence[tuple[str, str, int]], metadata: dict[str, str], options: BagOptions
    ) -> None:
        if options.compression != 'none':
            # Fail here rather than at the first chunk.
            try:
                require_zstd()
            except ValueError as error:
                raise InvalidParameterError('compression', options.compression, str(error)) from None
        self._path = path
        self._topics = bag_topics(topics)
        self._custom_data = dict(metadata)
        path.mkdir(parents=True)
        self._files: list[_File] = []
        self._options = options
        self._reserve = Reserve(path / 'reserve.tmp')
        try:
            self._keep_room(0)
            self._file = self._open()
        except OSError:
            self._reserve.release()
            raise

    def _keep_room(self, summary: int) -> None:
        """Reserve disk space for closing the bag, given the size of its summary without topics and metadata [bytes]."""
        if summary + _RESERVE_STEP > self._reserve.size:
            self._reserve.grow(2 * (summary + _RESERVE_STEP) if summary else _RESERVE_STEP)

    def _open(self) -> McapWriter:
        self._name = f'{self._path.name}_{len(self._files)}.mcap' if self._options.splits else f'{self._path.name}.mcap'
        channels = [_channel(topic) for topic in self._topics]
        library = f'hdd_servo_ros {__version__}'
        return McapWriter(self._path / self._name, channels, library, self._options.compression, self._keep_room)

    def write_ticks(self, topics: Sequence[int], messages: TickMessages) -> None:
        """Write the messages of ticks, one per topic and tick, in the order of ``topics`` within each tick."""
        times = messages.times
        first = 0
        while first < len(times):
            count = self._fitting(times[first : first + _TICKS_BETWEEN_SPLITS] if self._options.splits else times)
            self._file.write_ticks(topics, messages, slice(first, first + count))
            first += count

    def write_messages(
        self, topics: NDArray[np.int64], times: NDArray[np.int64], sizes: NDArray[np.int64], payloads: memoryview
    ) -> None:
        """Write messages of any size in any order; see :meth:`McapWriter.write_messages`."""
        ends = np.cumsum(sizes)
        first = 0
        while first < len(times):
            part = slice(first, first + self._fitting(times[first:]))
            begin, end = int(ends[part][0] - sizes[first]), int(ends[part][-1])
            self._file.write_messages(topics[part], times[part], sizes[part], payloads[begin:end])
            first = part.stop

    def _fitting(self, times: NDArray[np.int64]) -> int:
        """Return how many of the next messages fit into the file by their times [ns]; open a new file if none does."""
        longest = round(self._options.max_bag_duration * NANOSECONDS)
        begun = self._file.times
        if begun is not None:
            is_too_large = 0 < self._options.max_bag_size < self._file.size
            is_too_long = 0 < longest < times[0] - begun[0]
            if is_too_large or is_too_long:
                self._close_file()
                self._file = self._open()
                begun = None
        if not longest:
            return len(times)
        late = np.flatnonzero(times - (times[0] if begun is None else begun[0]) > longest)
        return int(late[0]) if len(late) else len(times)

    def flush(self) -> None:
        """Write the messages in memory, so that they survive the end of this process."""
        self._file.flush()

    def close(self) -> None:
        """
        Complete the last file, and write ``metadata.yaml``.

        Raises
        ------
        OSError
            If a part cannot be written; if these are messages, the bag is readable without them.
        """
        try:
            if not self._file.is_closed:
                self._file.finish_data()
        finally:
            # Everything from here on must fit into the reserved space.
            self._reserve.release()
            if not self._file.is_closed:
                self._write_summary()
            text = to_yaml({'rosbag2_bagfile_information': self._metadata(self._files)})
            write_durably(self._path / 'metadata.yaml', text, self._path / 'metadata.yaml.tmp')
            sync_folder(self._path.parent)

    def _close_file(self) -> None:
        self._file.finish_data()
        self._write_summary()

    def _write_summary(self) -> None:
        written = _File(self._name, self._file.counts, *(self._file.times or _NO_TIMES))
        self._file.write_summary('rosbag2', {'serialized_metadata': to_yaml(self._metadata([written])).strip()})
        self._files.append(written)

    def _metadata(self, files: Sequence['_File']) -> dict[str, Any]:
        """Return the content of ``metadata.yaml`` for some of the files."""
        counts = np.sum([file.counts for file in files], axis=0)
        total = _File('', counts, min(file.first for file in files), max(file.last for file in files))
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            'relative_file_paths': [file.name for file in files],
            **total.times_and_count(),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type_name,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': topic.offered_qos_profiles,
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': count,
                }
                for topic, count in zip(self._topics, counts.tolist(), strict=True)
            ],
            # This is rosbag2's own compression of messages or files, not that of MCAP chunks.
            'compression_format': '',
            'compression_mode': '',
            'files': [{'path': file.name, **file.times_and_count()} for file in files],
            'custom_data': self._custom_data or None,
            'ros_distro': 'jazzy',
        }


@dataclasses.dataclass(frozen=True)
class _File:
    """Name of a file, number of messages per topic, first and last time [ns]."""

    name: str
    counts: NDArray[np.int64]
    first: int
    last: int

    def times_and_count(self) -> dict[str, Any]:
        return {
            'starting_time': {'nanoseconds_since_epoch': self.first},
            'duration': {'nanoseconds': max(0, self.last - self.first)},
            'message_count': int(self.counts.sum()),
        }


def _channel(topic: BagTopic) -> Channel:
    metadata = {'offered_qos_profiles': to_yaml(topic.offered_qos_profiles).strip()}
    return Channel(topic.name, topic.type_name, topic.definition, topic.encoding, metadata)
