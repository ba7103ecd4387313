"""The topics of the loop: names, types and what their fields mean. The public contract; no ROS import."""

import dataclasses

CLOCK_TYPE = 'rosgraph_msgs/msg/Clock'
VECTOR_TYPE = 'geometry_msgs/msg/Vector3Stamped'
ARRAY_TYPE = 'std_msgs/msg/Float64MultiArray'
COUNT_TYPE = 'std_msgs/msg/UInt64'


@dataclasses.dataclass(frozen=True)
class LoopTopic:
    """A topic that carries exactly one message a tick; its name is relative, so that it follows namespaces."""

    name: str
    type_name: str
    fields: tuple[str, ...]
    """What x, y, z carry; lengths and voltages are in the units that the drive's parameter file names."""
    published_by: str
    """Who publishes it, for messages to a person who waits for it."""


CLOCK = LoopTopic('clock', CLOCK_TYPE, ('time of the tick, k T [ns]',), 'deterministic_timer')
REFERENCE = LoopTopic(
    'reference', VECTOR_TYPE, ('x_d [um]', 'dx_d/dt [um/s]', 'd2x_d/dt2 [um/s^2]'), 'reference_generator'
)
HEAD = LoopTopic('head', VECTOR_TYPE, ('head position [um]', 'head velocity [um/s]', 'pivot friction [V]'), 'vcm_plant')
LDV = LoopTopic('ldv', VECTOR_TYPE, ('displacement output [V]', 'velocity output [V]', '0'), 'ldv_sensor')
CONTROL = LoopTopic(
    'control',
    VECTOR_TYPE,
    ('drive voltage held over [kT, (k+1)T) [V]', 'voltage before saturation [V]', 'feedback part [V]'),
    'a controller',
)
ESTIMATES = LoopTopic('estimates', ARRAY_TYPE, ('named in layout.dim[0].label, comma-separated',), 'a controller')

DISTURBANCE = LoopTopic('disturbance', VECTOR_TYPE, ('disturbance at the actuator [V]', '0', '0'), 'a disturbance node')
"""Takes part when its node runs; the plant then waits for it as for any input."""

RECORDED = LoopTopic('recorded', COUNT_TYPE, ('ticks that the recorder has taken in',), 'bag_recorder')
"""How far the recorder is; it holds the timer back. Not part of the loop's data and not recorded."""

LOOP_TOPICS = (CLOCK, REFERENCE, HEAD, LDV, CONTROL, ESTIMATES)

SCOPE = 'scope'
"""Decimated signals for who looks on (``std_msgs/Float64MultiArray``); sent only while somebody does."""

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
"""The field of ``rcl_interfaces/ParameterValue`` that each of its types fills."""

QUEUE_DEPTH = 1024
"""Depth of every loop topic's queue, offered and requested: what the slowest recorder may lag behind, and more."""
