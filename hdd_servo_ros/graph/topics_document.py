"""`docs/topics.md`: every topic of the graph with its fields, writer and readers, from the contract of the topics."""

from collections.abc import Iterator

from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, NODES, resolve
from hdd_servo_ros.graph.connections import TOPICS, readers_of, shown_delay
from hdd_servo_ros.messages.topics import (
    ESTIMATES,
    PARAMETER_EVENT_TYPE,
    PARAMETER_EVENTS,
    QUEUE_DEPTH,
    RECORDER,
    SCOPE,
    LoopTopic,
)
from hdd_servo_ros.messages.units import shown

_INTRODUCTION = f"""\
# Topics

Written by `make docs` from the declarations in `hdd_servo_ros/messages/topics.py`, the same from which the nodes, the
recorder and `simulate` take their inputs and outputs. Change the declarations, not this file.

Names are relative in the code, so that they follow namespaces and remapping; shown here in the root namespace. A topic
of the loop carries exactly one message per tick, with the stamp k T of tick k, and `frame_id` names the drive. All are
reliable and keep the last {QUEUE_DEPTH} messages. Units are those of a drive in µm and V; a parameter file may name
others (`length_unit`, `control_unit`).

A node reads a topic at tick k with a *delay* of d ticks if it needs the message of tick k - d; `lookahead` is its
parameter. An *optional* topic is a topic of the loop in a run in which a node publishes it, and absent from others.
"""


def document() -> str:
    """Return the whole document as Markdown."""
    return '\n'.join(
        [_INTRODUCTION, *_overview(), '', *(line for topic in TOPICS for line in _section(topic)), *_others()]
    )


def _overview() -> Iterator[str]:
    yield '| topic | type | written by | read by |'
    yield '|---|---|---|---|'
    for topic in TOPICS:
        name = f'[/{topic.name}](#{topic.name})' + (', optional' if topic.is_optional else '')
        yield f'| {name} | `{_type(topic.type_name)}` | {_node(topic.writer)} | {", ".join(_readers(topic))} |'


def _section(topic: LoopTopic) -> Iterator[str]:
    yield f'## {topic.name}\n'
    yield f'`/{topic.name}`, `{_type(topic.type_name)}`: {topic.meaning}.\n'
    if topic is ESTIMATES:
        yield 'Its elements, by controller:\n\n| controller | elements |\n|---|---|'
        for name in CONTROLLERS.values():
            yield f'| `{name}` | {", ".join(f"`{label}`" for label in resolve(NODES[name].block).estimate_names)} |'
        yield ''
        return
    yield '| component | field | unit | meaning |\n|---|---|---|---|'
    for number, component in enumerate(topic.codec.components):
        if number < len(topic.fields):
            field = topic.fields[number]
            yield f'| {component} | `{field.name}` | {shown(field.unit) or "-"} | {field.meaning} |'
        else:
            yield f'| {component} | - | - | 0 |'
    yield ''


def _others() -> Iterator[str]:
    yield '## Other topics\n'
    yield 'No node waits for these.\n'
    yield '| topic | type | written by | meaning |\n|---|---|---|---|'
    yield (
        f'| {PARAMETER_EVENTS} | `{_type(PARAMETER_EVENT_TYPE)}` | every node | '
        'changes of parameters, stamped with the tick from which they act; recorded |'
    )
    yield (
        f'| /{SCOPE} | `std_msgs/Float64MultiArray` | `{RECORDER}` | '
        'decimated signals for live viewers, while there is a subscriber; not recorded |'
    )
    yield ''


def _readers(topic: LoopTopic) -> Iterator[str]:
    for reader in readers_of(topic):
        delay = shown_delay(topic, reader)
        unit = 'tick' if delay == '1' else 'ticks'
        yield _node(reader.node) + (f' (delay {delay} {unit})' if delay else '')


def _node(name: str) -> str:
    """Return a node's name, or its role in words."""
    if name == CONTROLLER:
        return 'the controller'
    return f'`{name}`' if name in NODES else f'{"an" if name[0] in "aeiou" else "a"} {name}'


def _type(name: str) -> str:
    return name.replace('/msg/', '/')
