"""Messages that a run takes no notice of: counted, and reported once a topic with whoever may have sent them."""

import collections
from collections.abc import Collection

from rclpy.node import Node

from hdd_servo_ros.ros.publishers import publishers_of

_REQUESTS = 'requests to services'


class IgnoredMessages:
    """
    Counts ignored messages.

    Parameters
    ----------
    node
        Lends its logger, and asks who publishes a topic.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.counts: collections.Counter[str] = collections.Counter()
        """How many messages were ignored, by topic."""

    def add(self, topic: str, why: str, expected: Collection[str]) -> None:
        """
        Count a message.

        Parameters
        ----------
        topic
            Full name of its topic.
        why
            Why it is ignored, in a few words.
        expected
            Full names of the nodes that publish the topic by right; a message does not tell who sent it.
        """
        self.counts[topic] += 1
        if self.counts[topic] > 1:
            return
        publishers = publishers_of(self._node, topic).split(', ')
        strangers = [name for name in publishers if name not in expected]
        self._node.get_logger().warning(
            f'{topic}: ignored a message ({why}), and will ignore further ones silently; '
            f'published by {", ".join(strangers or publishers)}'
        )

    def add_request(self, why: str) -> None:
        """Count a request to a service, which tells neither its service nor its sender."""
        self.counts[_REQUESTS] += 1
        if self.counts[_REQUESTS] == 1:
            self._node.get_logger().warning(f'{_REQUESTS}: ignored one ({why[:200]})')

    def report(self) -> None:
        """Say how many there were, if there were more than the one that was reported."""
        for topic, count in self.counts.items():
            if count > 1:
                self._node.get_logger().warning(f'{topic}: ignored {count} messages in all')
