"""Message types, definitions, hashes and quality of service of the topics of a rosbag2 bag."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import yaml

from hdd_servo_ros.recording.type_definitions import KNOWN, known_definition

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


@dataclasses.dataclass(frozen=True)
class BagTopic:
    """
    Topic of a bag.

    Attributes
    ----------
    name, type_name
        Absolute name, and type of the messages.
    depth
        Queue depth offered by its publishers.
    definition, encoding
        Text and language of the message definition.
    type_hash
        Hash of the type, as `ros2 topic info --verbose` prints it.
    """

    name: str
    type_name: str
    depth: int
    definition: str
    encoding: str
    type_hash: str

    @property
    def offered_qos_profiles(self) -> list[dict[str, Any]]:
        """The offered quality of service, as version 9 of the bag format writes it."""
        return [
            {
                'history': 'keep_last',
                'depth': self.depth,
                'reliability': 'reliable',
                'durability': 'volatile',
                'deadline': dict(_FOREVER),
                'lifespan': dict(_FOREVER),
                'liveliness': 'automatic',
                'liveliness_lease_duration': dict(_FOREVER),
                'avoid_ros_namespace_conventions': False,
            }
        ]


def bag_topics(topics: Sequence[tuple[str, str, int]]) -> list[BagTopic]:
    """Return topics, given by absolute name, type and queue depth, with the definitions and hashes of Jazzy."""
    return [BagTopic(name, type_name, depth, *_definition(type_name)) for name, type_name, depth in topics]


@functools.cache
def _definition(type_name: str) -> tuple[str, str, str]:
    """Return the definition of a type, its language and its hash."""
    if type_name in KNOWN:
        definition, type_hash = known_definition(type_name)
    else:
        types = _types()
        definition, _ = types.generate_msgdef(type_name, ros_version=2)
        type_hash = types.hash_rihs01(type_name)
    return definition, 'ros2msg', type_hash


@functools.cache
def _types() -> Any:
    # Imported only if needed: the import takes as long as recording thousands of ticks.
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def to_yaml(content: Any) -> str:
    """Return content as the YAML of rosbag2's metadata."""
    dumper: Any = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    text: str = yaml.dump(content, Dumper=dumper, default_flow_style=False)
    return text
