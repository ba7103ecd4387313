"""Inputs and outputs of each node, derived from the topic definitions; no ROS import."""

import dataclasses
import functools
from collections.abc import Iterator

from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, CONTROL, RECORDED, RECORDER, LoopTopic, Reader

TOPICS = (*ALL_LOOP_TOPICS, RECORDED)
"""Topics for which nodes of the graph wait, in the order of their definitions."""
_ADDED_DELAY = {(CONTROL.name, 'deterministic_timer'): 'lookahead'}
"""Parameters that increase the delay of a reader."""


@dataclasses.dataclass(frozen=True)
class TopicInput:
    """
    Topic that a node reads.

    Attributes
    ----------
    topic
        The topic.
    delay
        At tick k the node needs the message of tick k - ``delay``.
    """

    topic: LoopTopic
    delay: int = 0


@functools.cache
def inputs_of(node: str) -> tuple[TopicInput, ...]:
    """Return the inputs of a node in every run, in the order of the topic definitions."""
    return tuple(found for found in _all_inputs(node) if not found.topic.is_optional)


@functools.cache
def optional_inputs_of(node: str) -> tuple[TopicInput, ...]:
    """Return the inputs of a node in runs in which another node publishes them."""
    return tuple(found for found in _all_inputs(node) if found.topic.is_optional)


@functools.cache
def outputs_of(node: str) -> tuple[LoopTopic, ...]:
    """Return the topics that a node publishes, in the order of the topic definitions."""
    return tuple(topic for topic in TOPICS if topic.writer in _names(node))


def readers_of(topic: LoopTopic) -> tuple[Reader, ...]:
    """Return all readers of a topic, including the recorder."""
    return topic.readers if topic is RECORDED else (*topic.readers, Reader(RECORDER))


def shown_delay(topic: LoopTopic, reader: Reader) -> str:
    """Return the delay of a reader as text, such as ``1 + lookahead``; empty for no delay."""
    added = _ADDED_DELAY.get((topic.name, reader.node))
    return ' + '.join(filter(None, (str(reader.delay or ''), added)))


def _names(node: str) -> tuple[str, str]:
    """Return the names of a node in topic definitions: its own and its role."""
    return node, NODES[node].role


def _all_inputs(node: str) -> Iterator[TopicInput]:
    if node == RECORDER:
        yield from map(TopicInput, ALL_LOOP_TOPICS)
        return
    for topic in TOPICS:
        for reader in topic.readers:
            if reader.node in _names(node):
                yield TopicInput(topic, reader.delay)
