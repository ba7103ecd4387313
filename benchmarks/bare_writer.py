"""The `rosbags` writer, one message at a time, as the baseline of the bulk writer of bags."""

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)


class BareWriter:
    """Writer of an MCAP bag with the interface of `BagWriter`."""

    def __init__(self, path, topics):
        self.writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self.writer.open()
        self.connections = [self.writer.add_connection(name, kind, typestore=TYPES) for name, kind, _ in topics]

    def write(self, topics, stamps, messages):
        for topic, stamp, message in zip(topics, stamps, messages, strict=True):
            self.writer.write(self.connections[topic], stamp, message)

    def close(self):
        self.writer.close()
