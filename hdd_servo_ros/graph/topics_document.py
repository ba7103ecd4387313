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
`deterministic_timer`. `accelerometer` needs `/control` for its parasitic path: the reaction of the actuator on the
base. An *optional* topic belongs to the loop in runs in which a node publishes it, and is absent from others. `/pes`
replaces `/ldv` in runs with the servo sensor.
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
    'control_updates.quarter': 'accelerates toward positive positions',
    'disturbance.force': 'acts against u',
    'disturbance.track_center': 'that of the head position',
    'base_acceleration.linear_y': 'positive: force against u, if the imbalance is positive',
    'base_acceleration.angular_z': 'positive: force against u',
    'accelerometer.output_1': 'that of a + alpha d/2',
    'accelerometer.output_2': 'that of a - alpha d/2',
    'pes.error': 'positive beyond the track center',
    'pes.position': 'that of the head position',
}
"""Sign of a field, by topic and field, where its quantity does not determine it."""
_ESTIMATES = """\
Its elements, by controller. Options append more elements: [seek](../controllers/seek.md#inputs-and-outputs) (always in
`seek_controller`), [vibration feedforward](../controllers/vibration-feedforward.md#inputs-and-outputs), [runout
compensation](../controllers/runout-compensation.md#inputs-and-outputs), and the
[observer](../instruments/servo-sensor.md), with `observed_position` [µm] and `observed_velocity` [µm/s].
"""
_ELEMENTS = {
    't': ('s', 'time of the tick'),
    'e': ('um', 'measured position error'),
    'r': ('um/s', 'filtered error'),
    'sigma_hat': ('V s/um', 'estimate of the viscous friction'),
    'm_hat': ('V s^2/um', 'estimate of the inertia'),
    'phi_hat': ('V', 'estimate of the bound on network error and disturbance'),
    'W_norm': ('V', 'norm of the network weights W_hat'),
    'network': ('V', "output of the network W_hat'S"),
    'integral': ('V', 'integral part of u'),
    'adaptive_nn_controller.integral': ('um s', 'integral of e'),
    'derivative': ('V', 'derivative part of u'),
    'position_width': ('um', 'width of the lattice over position'),
    'velocity_width': ('um/s', 'width of the lattice over velocity'),
    'compensator': ('V', 'output of the hysteresis compensator'),
    'spring_hat': ('V/um', 'estimated stiffness of the wider bristle'),
    'hysteresis_hat': ('V/um', 'estimated stiffness of the difference between both bristles'),
    'relaxation_hat': ('V s/um', 'estimated damping of the bristles'),
    'bristles': ('V', 'estimated bristle friction'),
    'point': ('', 'index of the point of the sweep'),
    'frequency': ('Hz', 'frequency of the excitation'),
    'amplitude': ('V', 'amplitude of the excitation'),
    'real': ('um/V', 'real part of the response of the last finished point'),
    'imag': ('um/V', 'imaginary part of the response of the last finished point'),
    'coherence': ('', 'coherence of the last finished point'),
}
"""Unit and quantity of the elements of `/estimates`, by name, or by controller and name."""
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
        yield _ESTIMATES
        yield '| controller | element | unit | quantity |\n|---|---|---|---|'
        for name in CONTROLLERS.values():
            for label in resolve(NODES[name].block).estimate_names:
                unit, quantity = _ELEMENTS.get(f'{name}.{label}') or _ELEMENTS[label]
                yield f'| `{name}` | `{label}` | {shown(unit) or "-"} | {quantity} |'
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
