"""Publishers of a topic as discovered by DDS."""

from rclpy.node import Node

UNDISCOVERED_NODE = 'an undiscovered or vanished node'


def publishers_of(node: Node, topic: str) -> str:
    """Return the names of the nodes that publish a topic, for messages."""
    names = [
        UNDISCOVERED_NODE if 'UNKNOWN' in info.node_name else f'{info.node_namespace.rstrip("/")}/{info.node_name}'
        for info in node.get_publishers_info_by_topic(topic)
    ]
    return ', '.join(sorted(names)) or 'no node at present'
