"""Which topics each node reads and writes: the contract of the topics, asked by a node's name. No ROS import."""

import dataclasses
import functools
from collections.abc import Iterator

from hdd_servo_ros.graph.catalog import NODES
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, CONTROL, RECORDED, RECORDER, LoopTopic, Reader

TOPICS = (*ALL_LOOP_TOPICS, RECORDED)
"""The topics that nodes of the graph wait for, in the contract's order."""
_ADDED_DELAY = {(CONTROL.name, 'deterministic_timer'): 'lookahead'}
"""Parameters by which a reader adds to its delay."""


@dataclasses.dataclass(frozen=True)
class TopicInput:
    """
    A topic that a node reads.

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
    """Return what a node of the catalog reads in every run, in the contract's order."""
    return tuple(found for found in _all_inputs(node) if not found.topic.is_optional)


@functools.cache
def optional_inputs_of(node: str) -> tuple[TopicInput, ...]:
    """Return what a node of the catalog reads in a run in which another node publishes it."""
    return tuple(found for found in _all_inputs(node) if found.topic.is_optional)


@functools.cache
def outputs_of(node: str) -> tuple[LoopTopic, ...]:
    """Return the topics that a node of the catalog publishes, in the contract's order."""
    return tuple(topic for topic in TOPICS if topic.writer in _names(node))


def readers_of(topic: LoopTopic) -> tuple[Reader, ...]:
    """Return all who read a topic, the recorder among them."""
    return topic.readers if topic is RECORDED else (*topic.readers, Reader(RECORDER))


def shown_delay(topic: LoopTopic, reader: Reader) -> str:
    """Return a reader's delay as a person reads it, such as ``1 + lookahead``; empty for none."""
    added = _ADDED_DELAY.get((topic.name, reader.node))
    return ' + '.join(filter(None, (str(reader.delay or ''), added)))


def _names(node: str) -> tuple[str, str]:
    """Return the names by which a topic may mean a node: its own and its role."""
    return node, NODES[node].role


def _all_inputs(node: str) -> Iterator[TopicInput]:
    if node == RECORDER:
        yield from map(TopicInput, ALL_LOOP_TOPICS)
        return
    for topic in TOPICS:
        for reader in topic.readers:
            if reader.node in _names(node):
                yield TopicInput(topic, reader.delay)
