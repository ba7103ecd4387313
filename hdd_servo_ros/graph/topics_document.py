"""`docs/reference/topics.md`: every topic with its fields, publisher and subscribers, from the declarations."""

from collections.abc import Iterator

from hdd_servo_ros.graph.catalog import CONTROLLER, CONTROLLERS, NODES, resolve
from hdd_servo_ros.graph.connections import TOPICS, readers_of, shown_delay
from hdd_servo_ros.messages.codecs import CLOCKS, REPORTS
from hdd_servo_ros.messages.topics import (
    ESTIMATES,
    PARAMETER_EVENT_TYPE,
    PARAMETER_EVENTS,
    QUEUE_DEPTH,
    RECORDED,
    RECORDER,
    SCOPE,
    LoopTopic,
)
from hdd_servo_ros.messages.units import shown

_INTRODUCTION = """\
# Topics

Written by `make docs` from the declarations in `hdd_servo_ros/messages/topics.py`. The nodes, the recorder and
`simulate` use the same declarations. Change them, not this file.

Topic names are relative in the code, so that namespaces and remapping apply. This page shows them in the root
namespace. A topic of the loop carries exactly one message per tick. Its stamp is k T, the time of tick k. Every topic
of the loop has exactly one publisher.

A subscriber with a *delay* of d ticks needs the message of tick k - d at tick k. `lookahead` is a parameter of
`deterministic_timer`. An *optional* topic belongs to the loop in runs in which a node publishes it, and is absent from
others. `/pes` replaces `/ldv` in runs with the servo sensor.
"""
_CONVENTIONS = """\
## Units and signs

Units are those of a drive in µm and V; a parameter file may name others (`length_unit`, `control_unit`). Outputs of
instruments are in V, and accelerations in m/s^2 and rad/s^2, in every run.

- The position error is e = x - x_d: positive where the head is beyond the reference.
- Friction is positive where it opposes a positive velocity.
- The disturbance force acts against u: a positive force decelerates a positive motion.
- Friction and disturbance are in V: the voltage that would balance them.

[Notation](notation.md#conventions) has the other conventions.
"""
_SIGNS = {
    'reference.position': 'positive in the direction of a positive u',
    'head.position': 'positive in the direction of a positive u',
    'head.friction': 'opposes a positive velocity',
    'ldv.displacement': 'that of the head position',
    'ldv.velocity': 'that of the head velocity',
    'control.voltage': 'accelerates toward positive positions',
    'disturbance.force': 'acts against u',
    'disturbance.track_center': 'that of the head position',
    'pes.error': 'positive beyond the track center',
    'pes.position': 'that of the head position',
}
"""Sign of a field, by topic and field, where its quantity does not determine it."""
_QUALITY_OF_SERVICE = f"""\
## Quality of service

| topics | reliability | history | durability |
|---|---|---|---|
| the topics of the loop, `/{RECORDED.name}` | reliable | keep last {QUEUE_DEPTH} | volatile |
| `/{SCOPE}` | best effort | keep last 5 | volatile |
| `/diagnostics` | reliable | keep last 10 | volatile |
| `/lockstep` | reliable | keep last 100 | volatile |
| `{PARAMETER_EVENTS}`, `/rosout` | as in any node | | |

These are fixed, so that no run loses a message: parameters `qos_overrides.*` are rejected. Subscribers with default
settings are compatible with every topic except `/{SCOPE}`; best-effort subscribers are compatible with all of them.
"""
_OTHERS = f"""\
## Other topics

The loop does not wait for these. Their names follow the namespace, except those of `/diagnostics`,
`{PARAMETER_EVENTS}` and `/rosout`.

| topic | type | publisher | content | recorded |
|---|---|---|---|---|
| `{PARAMETER_EVENTS}` | `{PARAMETER_EVENT_TYPE.replace('/msg/', '/')}` | every node | parameter changes; the stamp is \
the tick from which they act | yes |
| `/{SCOPE}` | `std_msgs/Float64MultiArray` | `{RECORDER}` | decimated signals for live viewers, while there is a \
subscriber | no |
| `/diagnostics` | `diagnostic_msgs/DiagnosticArray` | every process | [status of the nodes]\
(../howto/monitor.md#diagnostics), while there is a subscriber; the stamp is wall time | no |
| `/lockstep` | `std_msgs/String` | every process | JSON announcements, by which the processes discover and monitor \
each other | no |

Services are in [change parameters and control a run](../howto/change-parameters.md#start-pause-step-stop-reset).
"""


def document() -> str:
    """Return the page as Markdown."""
    sections = (line for topic in TOPICS for line in _section(topic))
    return '\n'.join([_INTRODUCTION, *_overview(), '', _CONVENTIONS, *sections, _OTHERS, _QUALITY_OF_SERVICE])


def _overview() -> Iterator[str]:
    yield '| topic | type | publisher | subscribers | time in the message | `frame_id` | recorded |'
    yield '|---|---|---|---|---|---|---|'
    for topic in TOPICS:
        cells = (
            f'[/{topic.name}](#{topic.name})' + (', optional' if topic.is_optional else ''),
            f'`{_type(topic.type_name)}`',
            _node(topic.writer),
            ', '.join(_subscribers(topic)),
            _stamp(topic),
            _frame(topic),
            'no' if topic is RECORDED else 'yes',
        )
        yield f'| {" | ".join(cells)} |'


def _section(topic: LoopTopic) -> Iterator[str]:
    yield f'## {topic.name}\n'
    yield f'`/{topic.name}`, `{_type(topic.type_name)}`: {topic.meaning}.\n'
    if topic is ESTIMATES:
        yield 'Its elements, by controller. The first, `t`, is the time of the tick [s].\n'
        yield '| controller | elements |\n|---|---|'
        for name in CONTROLLERS.values():
            yield f'| `{name}` | {", ".join(f"`{label}`" for label in resolve(NODES[name].block).estimate_names)} |'
        yield ''
        return
    yield '| component | field | unit | quantity | sign |\n|---|---|---|---|---|'
    for number, component in enumerate(topic.codec.components):
        if number < len(topic.fields):
            field = topic.fields[number]
            sign = _SIGNS.get(f'{topic.name}.{field.name}', '-')
            yield f'| {component} | `{field.name}` | {shown(field.unit) or "-"} | {field.meaning} | {sign} |'
        else:
            yield f'| {component} | - | - | 0 | - |'
    yield ''


def _subscribers(topic: LoopTopic) -> Iterator[str]:
    for reader in readers_of(topic):
        delay = shown_delay(topic, reader)
        unit = 'tick' if delay == '1' else 'ticks'
        yield _node(reader.node) + (f' (delay {delay} {unit})' if delay else '')


def _stamp(topic: LoopTopic) -> str:
    """Return the part of a message that holds the time of its tick."""
    if topic.codec is CLOCKS:
        return '`clock`'
    if topic.codec is REPORTS:
        return '`stamp`'
    return '`header.stamp`' if topic.codec.is_stamped else 'element `t`'


def _frame(topic: LoopTopic) -> str:
    if topic.codec is REPORTS:
        return 'the run'
    return 'the drive' if topic.codec.is_stamped and topic.codec is not CLOCKS else '-'


def _node(name: str) -> str:
    """Return the name of a node, or its role in words."""
    if name == CONTROLLER:
        return 'the controller'
    return f'`{name}`' if name in NODES else f'{"an" if name[0] in "aeiou" else "a"} {name}'


def _type(name: str) -> str:
    return name.replace('/msg/', '/')
