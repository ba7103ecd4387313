"""Messages that a run ignores: counted, and reported once per topic with the possible senders."""

import collections
from collections.abc import Collection

from rclpy.node import Node

from hdd_servo_ros.ros.publishers import publishers_of

_REQUESTS = 'requests to services'


class IgnoredMessages:
    """
    Counter of ignored messages.

    Parameters
    ----------
    node
        Node whose logger is used; it also looks up the publishers of a topic.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.counts: collections.Counter[str] = collections.Counter()
        """Number of ignored messages, by topic."""

    def add(self, topic: str, why: str, expected: Collection[str]) -> None:
        """
        Count a message.

        Parameters
        ----------
        topic
            Full name of its topic.
        why
            Short reason why it is ignored.
        expected
            Full names of the legitimate publishers of the topic; a message does not contain its sender.
        """
        self.counts[topic] += 1
        if self.counts[topic] > 1:
            return
        publishers = publishers_of(self._node, topic).split(', ')
        external = [name for name in publishers if name not in expected]
        self._node.get_logger().warning(
            f'{topic}: ignored a message ({why}), and will ignore further ones silently; '
            f'published by {", ".join(external or publishers)}'
        )

    def add_request(self, why: str) -> None:
        """Count an invalid service request; neither its service nor its sender is known."""
        self.counts[_REQUESTS] += 1
        if self.counts[_REQUESTS] == 1:
            self._node.get_logger().warning(f'{_REQUESTS}: ignored one ({why[:200]})')

    def report(self) -> None:
        """Log the number of ignored messages of each topic with more than the one reported."""
        for topic, count in self.counts.items():
            if count > 1:
                self._node.get_logger().warning(f'{topic}: ignored {count} messages in all')
