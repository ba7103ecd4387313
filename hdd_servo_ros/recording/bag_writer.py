"""A rosbag2 bag written with `rosbags`, carrying what `ros2 bag info` of Jazzy reads."""

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_typestore

STORAGES = ('mcap', 'sqlite3')
_WRITTEN_BY = 'ros_distro: rosbags'
_DISTRIBUTION = 'ros_distro: jazzy'
_FOREVER = QosTime(9223372036, 854775807)
_TYPES = get_typestore(Stores.ROS2_JAZZY)


class _JazzyMcapWriter(McapWriter):
    def close(self, version: int, metadata: str) -> None:
        super().close(version, metadata.replace(_WRITTEN_BY, _DISTRIBUTION))


class _JazzySqlite3Writer(Sqlite3Writer):
    SQLITE_SCHEMA = Sqlite3Writer.SQLITE_SCHEMA.replace("'rosbags'", "'jazzy'")

    def close(self, version: int, metadata: str) -> None:
        super().close(version, metadata.replace(_WRITTEN_BY, _DISTRIBUTION))


class _JazzyWriter(Writer):
    """`rosbags` names itself as the distribution; the message definitions and hashes here are Jazzy's."""

    STORAGE_PLUGINS = MappingProxyType(
        {StoragePlugin.MCAP: _JazzyMcapWriter, StoragePlugin.SQLITE3: _JazzySqlite3Writer}
    )

    def close(self) -> None:
        super().close()
        temporary = self.metapath.with_suffix('.yaml.tmp')
        temporary.write_text(self.metapath.read_text('utf8').replace(_WRITTEN_BY, _DISTRIBUTION), 'utf8')
        temporary.replace(self.metapath)


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


class BagWriter:
    """
    Write serialized messages into a new bag.

    Parameters
    ----------
    path
        Folder of the bag; it must not exist.
    storage
        ``mcap`` or ``sqlite3``.
    topics
        Absolute name, type name and offered queue depth of each topic; messages name a topic by its index here.
    metadata
        Texts kept in the bag's ``custom_data``.

    Raises
    ------
    ValueError
        If the storage is unknown.
    rosbags.rosbag2.WriterError
        If the path exists already: nothing is overwritten.
    """

    def __init__(
        self, path: Path, storage: str, topics: Sequence[tuple[str, str, int]], metadata: dict[str, str]
    ) -> None:
        if storage not in STORAGES:
            raise ValueError(f'parameter storage = {storage!r} is refused: one of {", ".join(STORAGES)}')
        self._writer = _JazzyWriter(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
        for key, text in metadata.items():
            self._writer.set_custom_data(key, text)
        self._writer.open()
        self._connections: list[Connection] = [
            self._writer.add_connection(name, type_name, typestore=_TYPES, offered_qos_profiles=(_offered_qos(depth),))
            for name, type_name, depth in topics
        ]

    def write(self, topics: Sequence[int], stamps: Sequence[int], messages: Sequence[bytes | memoryview]) -> None:
        """Write messages in order: index of the topic, receive time [ns] and payload of each."""
        write, connections = self._writer.write, self._connections
        for topic, stamp, message in zip(topics, stamps, messages, strict=True):
            write(connections[topic], stamp, message)

    def close(self) -> None:
        """Write the index and ``metadata.yaml``: from here on the bag is complete."""
        self._writer.close()
