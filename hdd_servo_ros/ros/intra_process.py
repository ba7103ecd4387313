"""
Intra-process communication between loop nodes, as in rclcpp; rclpy provides none.

A topic that is published and read in this process needs no middleware. Its publisher and subscriptions remain, so that
the ROS graph is unchanged. While a subscription of another process is matched, the messages are also published over
DDS: a subscriber that joins receives every message from then on.
"""

from collections.abc import Callable, Sequence

from rclpy.publisher import Publisher

from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.run_plan import RunPlan

Publish = Callable[[bytes], None]


class IntraProcess:
    """
    Topics of a run that nodes of this process publish.

    Parameters
    ----------
    nodes
        The loop nodes of this process; they have begun the run.
    run
        The run.
    """

    def __init__(self, nodes: Sequence[LoopNode], run: RunPlan) -> None:
        own = {node.get_fully_qualified_name() for node in nodes}
        read_elsewhere = {
            name for node, metadata in run.nodes.items() if node not in own for name in metadata['inputs']
        }
        self._topics = [
            _LocalTopic(node, output, publisher, nodes, publisher.topic_name in read_elsewhere)
            for node in nodes
            for output, publisher in enumerate(node.loop_publishers)
        ]
        self.follow_subscriptions()

    def follow_subscriptions(self) -> None:
        """Publish over DDS only topics with a subscription in another process; called between two ticks."""
        for topic in self._topics:
            topic.follow_subscriptions()


class _LocalTopic:
    """Topic that a node of this process publishes."""

    def __init__(
        self, node: LoopNode, output: int, publisher: Publisher, nodes: Sequence[LoopNode], is_read_elsewhere: bool
    ) -> None:
        self._node = node
        self._output = output
        self._publisher = publisher
        # Readers in the run need tick 0, and a count of subscriptions could mistake another subscription for a reader.
        self._is_read_elsewhere = is_read_elsewhere
        inputs = dict.fromkeys(port for reader in nodes for port in (*reader.inputs, *reader.optional_inputs))
        readers = [port for port in inputs if port.name == publisher.topic_name]
        self._own_subscriptions = len(readers)
        queues = [port.read_locally() for port in readers]
        self._local = _to_all([queue.append for queue in queues])
        self._local_and_dds = _to_all([*(queue.append for queue in queues), publisher.handle.publish_raw])

    def follow_subscriptions(self) -> None:
        """Select how the node publishes the topic from now on."""
        is_outside = self._is_read_elsewhere or self._publisher.get_subscription_count() > self._own_subscriptions
        self._node.publish_by(self._output, self._local_and_dds if is_outside else self._local)


def _to_all(receivers: Sequence[Publish]) -> Publish:
    """Return a function that passes a message to each receiver, in their order."""
    if len(receivers) == 1:
        return receivers[0]
    receivers = tuple(receivers)

    def give(message: bytes) -> None:
        for receive in receivers:
            receive(message)

    return give
