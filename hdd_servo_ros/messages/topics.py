"""
Topics of the graph, declared once: name, type, fields with units, publisher, subscribers and timing.

The kernel's rows, the nodes' inputs, the recorder, `simulate`, :class:`~hdd_servo_ros.Run`, the comparison of bags, the
live view and ``docs/reference/topics.md`` use these declarations. No ROS import.
"""

import dataclasses
from collections.abc import Collection

from hdd_servo_ros.messages.codecs import ACCELERATIONS, ARRAYS, CLOCKS, REPORTS, VECTORS, Codec
from hdd_servo_ros.messages.units import Units

CONTROLLER = 'controller'
"""Role of the controller node, which closes the loop."""
DISTURBANCE_SOURCE = 'disturbance source'
"""Role of a node that disturbs the drive."""
POSITION_SENSOR = 'position sensor'
"""Role of the node that measures the head's position: the vibrometer or the servo sensor."""
BASE_SENSOR = 'accelerometer'
"""Role of a node that measures the acceleration of the base."""
RECORDER = 'bag_recorder'


@dataclasses.dataclass(frozen=True)
class Field:
    """
    Single number of a message.

    Attributes
    ----------
    name
        Name, also the attribute of :class:`~hdd_servo_ros.messages.signals.SignalArray`.
    unit
        Unit for a drive in um and V; see :class:`~hdd_servo_ros.messages.units.Units` for other drives.
    meaning
        Short description.
    is_in_drive_units
        Whether the unit follows that of the drive; the output of an instrument is in V for every drive.
    """

    name: str
    unit: str
    meaning: str
    is_in_drive_units: bool = True

    def unit_in(self, units: Units) -> str:
        """Return the unit in a run with these units of the drive."""
        return units.of(self.unit) if self.is_in_drive_units else self.unit


@dataclasses.dataclass(frozen=True)
class Reader:
    """
    Node that waits for a topic.

    Attributes
    ----------
    node
        Name of the node, or its role.
    delay
        At tick k the node needs the message of tick k - ``delay``.
    """

    node: str
    delay: int = 0


@dataclasses.dataclass(frozen=True)
class LoopTopic:
    """
    Topic with exactly one message per tick.

    Attributes
    ----------
    name
        Relative name, so that namespaces and remapping apply.
    codec
        Message type, with packing and unpacking.
    fields
        Numbers of the message, in the order of its components; undeclared components are 0. Empty for an array, whose
        elements are named in ``layout.dim[0].label``.
    writer
        Name or role of the node that publishes it.
    readers
        Nodes that wait for it; the recorder subscribes to every topic of the loop.
    meaning
        Short description.
    is_optional
        Whether a run can do without it.
    replaced_by
        Name of the optional topic that replaces this topic in a run in which a node publishes it; empty for none. The
        readers of this topic then wait for the other one.
    """

    name: str
    codec: Codec
    fields: tuple[Field, ...]
    writer: str
    readers: tuple[Reader, ...]
    meaning: str
    is_optional: bool = False
    replaced_by: str = ''

    @property
    def type_name(self) -> str:
        """ROS message type."""
        return self.codec.type_name

    @property
    def field_names(self) -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(field.name for field in self.fields)


_BASE_AXES = (
    ('x', 'along the arm'),
    ('y', 'across the arm, the direction of head motion; acts on the head'),
    ('z', 'along the pivot axis'),
)
_BASE_TURNS = (('x', 'about x'), ('y', 'about y'), ('z', 'about the pivot axis; acts on the head'))

CLOCK = LoopTopic(
    'clock',
    CLOCKS,
    (Field('time', 'ns', 'time of the tick, k T exactly'),),
    'deterministic_timer',
    (Reader('reference_generator'), Reader('vcm_plant'), Reader(DISTURBANCE_SOURCE)),
    'the tick',
)
REFERENCE = LoopTopic(
    'reference',
    VECTORS,
    (
        Field('position', 'um', 'desired position x_d'),
        Field('velocity', 'um/s', 'desired velocity dx_d/dt'),
        Field('acceleration', 'um/s^2', 'desired acceleration d2x_d/dt2'),
    ),
    'reference_generator',
    (Reader(CONTROLLER),),
    'desired trajectory of the head',
)
HEAD = LoopTopic(
    'head',
    VECTORS,
    (
        Field('position', 'um', 'head position'),
        Field('velocity', 'um/s', 'head velocity'),
        Field('friction', 'V', 'pivot friction'),
    ),
    'vcm_plant',
    (Reader('ldv_sensor'), Reader('servo_sensor')),
    'ground truth of the drive',
)
LDV = LoopTopic(
    'ldv',
    VECTORS,
    (
        Field('displacement', 'V', 'displacement output', is_in_drive_units=False),
        Field('velocity', 'V', 'velocity output', is_in_drive_units=False),
    ),
    'ldv_sensor',
    (Reader(CONTROLLER),),
    'outputs of the laser Doppler vibrometer',
    replaced_by='pes',
)
CONTROL = LoopTopic(
    'control',
    VECTORS,
    (
        Field('voltage', 'V', 'drive voltage u, held over [kT, (k+1)T)'),
        Field('before_saturation', 'V', 'u before saturation'),
        Field('feedback', 'V', 'feedback part of u, without feedforward and compensation'),
    ),
    CONTROLLER,
    (Reader('vcm_plant', delay=1), Reader('deterministic_timer', delay=1), Reader(BASE_SENSOR, delay=1)),
    'command to the drive',
)
ESTIMATES = LoopTopic(
    'estimates', ARRAYS, (), CONTROLLER, (), 'internal state of the controller, named in layout.dim[0].label'
)
DISTURBANCE = LoopTopic(
    'disturbance',
    VECTORS,
    (
        Field('force', 'V', 'force against u, held over [kT, (k+1)T)'),
        Field('track_center', 'um', 'displacement of the track center'),
    ),
    DISTURBANCE_SOURCE,
    (Reader('vcm_plant', delay=1), Reader('servo_sensor')),
    'external disturbance of the drive',
    is_optional=True,
)
BASE_ACCELERATION = LoopTopic(
    'base_acceleration',
    ACCELERATIONS,
    (
        *(Field(f'linear_{axis}', 'm/s^2', f'linear acceleration {along}', False) for axis, along in _BASE_AXES),
        *(Field(f'angular_{axis}', 'rad/s^2', f'angular acceleration {about}', False) for axis, about in _BASE_TURNS),
    ),
    DISTURBANCE_SOURCE,
    (Reader(BASE_SENSOR, delay=1),),
    'acceleration of the base of the drive, held over [kT, (k+1)T)',
    is_optional=True,
)
ACCELEROMETER = LoopTopic(
    'accelerometer',
    VECTORS,
    (
        Field('output_1', 'V', 'output of the first sensor', is_in_drive_units=False),
        Field('output_2', 'V', 'output of the second sensor', is_in_drive_units=False),
    ),
    BASE_SENSOR,
    (Reader(CONTROLLER),),
    'acceleration of the base, measured by two sensors',
    is_optional=True,
)

PES = LoopTopic(
    'pes',
    VECTORS,
    (
        Field('error', 'um', 'decoded position error: distance from the nearest track center, within half a track'),
        Field('position', 'um', 'decoded position including the track number, used by the controller'),
        Field('sector', '', 'number of the servo sector', False),
    ),
    'servo_sensor',
    (Reader(CONTROLLER),),
    'position decoded from the servo sectors; replaces /ldv',
    is_optional=True,
)

CONTROL_UPDATES = LoopTopic(
    'control_updates',
    VECTORS,
    (
        Field('quarter', 'V', 'drive voltage from (k + 1/4) T on'),
        Field('half', 'V', 'drive voltage from (k + 1/2) T on'),
        Field('three_quarters', 'V', 'drive voltage from (k + 3/4) T on, held until (k + 1) T'),
    ),
    CONTROLLER,
    (Reader('vcm_plant', delay=1),),
    'later voltages of the sample that begins with x of /control, in a run with dsp.updates_per_sample of 2 or 4',
    is_optional=True,
)

LOOP_TOPICS = (CLOCK, REFERENCE, HEAD, LDV, CONTROL, ESTIMATES)
"""Topics of every run with the vibrometer, in the order of the data flow in a tick."""
OPTIONAL_TOPICS = (DISTURBANCE, BASE_ACCELERATION, ACCELEROMETER, PES, CONTROL_UPDATES)
"""Topics of the runs in which a node publishes them; they are then loop topics like the others."""
ALL_LOOP_TOPICS = (*LOOP_TOPICS, *OPTIONAL_TOPICS)
SIGNAL_TOPICS = tuple(topic for topic in ALL_LOOP_TOPICS if topic is not CLOCK)
"""Topics with signals."""
KERNEL_TOPICS = (
    REFERENCE,
    HEAD,
    LDV,
    CONTROL,
    ESTIMATES,
    DISTURBANCE,
    BASE_ACCELERATION,
    ACCELEROMETER,
    PES,
    CONTROL_UPDATES,
)
"""Topics that the compiled kernel reads or writes, in the order of its rows."""


def topics_of_run(optional: Collection[LoopTopic]) -> tuple[LoopTopic, ...]:
    """
    Return the topics of a run, in the order of the recorder.

    Parameters
    ----------
    optional
        Optional topics that nodes of this run publish.
    """
    present = {topic.name for topic in optional}
    required = (topic for topic in LOOP_TOPICS if topic.replaced_by not in present)
    return (*required, *(topic for topic in OPTIONAL_TOPICS if topic.name in present))


RECORDED = LoopTopic(
    'recorded',
    REPORTS,
    (
        Field('tick', 's', 'time of the last tick that the recorder has received', False),
        Field('run', '', 'identifier of the run, set by the process of deterministic_timer', False),
    ),
    RECORDER,
    (Reader('deterministic_timer'),),
    'progress of the recorder, which holds back the timer; not recorded',
    is_optional=True,
)

SCOPE = 'scope'
"""Decimated signals for live viewers (``std_msgs/Float64MultiArray``); published only while there is a subscriber."""

PARAMETER_EVENTS = '/parameter_events'
PARAMETER_EVENT_TYPE = 'rcl_interfaces/msg/ParameterEvent'
PARAMETER_VALUE_FIELDS = {
    1: 'bool_value',
    2: 'integer_value',
    3: 'double_value',
    4: 'string_value',
    5: 'byte_array_value',
    6: 'bool_array_value',
    7: 'integer_array_value',
    8: 'double_array_value',
    9: 'string_array_value',
}
"""Field of ``rcl_interfaces/ParameterValue`` for each of its types."""

QUEUE_DEPTH = 1024
"""Depth of every loop topic's queue, offered and requested; exceeds the largest lag of the recorder."""
