"""Topic names of a run under the remap rules of its command line; no ROS import."""

from collections.abc import Sequence

from hdd_servo_ros.graph.connections import TOPICS, inputs_of, optional_inputs_of, outputs_of
from hdd_servo_ros.messages.topics import LoopTopic
from hdd_servo_ros.parameters.files import ArgumentError, RosArguments


def topic_names(arguments: RosArguments, nodes: Sequence[str]) -> dict[LoopTopic, str]:
    """
    Return the full names of the topics between the nodes of a run.

    Parameters
    ----------
    arguments
        The command line.
    nodes
        Catalog names of all nodes of the run.

    Raises
    ------
    ArgumentError
        If two nodes would use different names for a topic, so that the run could not start, or two topics would have
        the same name.
    """
    names: dict[LoopTopic, str] = {}
    by_name: dict[str, LoopTopic] = {}
    written = {topic for node in nodes for topic in outputs_of(node)}
    for topic in (topic for topic in TOPICS if topic in written):
        for node in nodes:
            read = (*inputs_of(node), *optional_inputs_of(node))
            if topic not in outputs_of(node) and all(found.topic is not topic for found in read):
                continue
            name = arguments.remaps.topic(node, topic.name)
            if names.setdefault(topic, name) != name:
                raise ArgumentError(
                    f'the remap rules give the topic {topic.name} the names {names[topic]} and, for {node}, {name}: '
                    'all nodes must use the same name'
                )
        other = by_name.setdefault(names[topic], topic)
        if other is not topic:
            raise ArgumentError(
                f'the remap rules give the topics {other.name} and {topic.name} the same name {names[topic]}'
            )
    return names
