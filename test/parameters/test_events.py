"""Parameter events as bytes: the same as ROS reads and writes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message

from hdd_servo_ros.parameters.events import (
    NodeChange,
    change_of_event,
    pack_parameter_event,
    unpack_parameter_event,
)

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
INTEGERS = st.integers(-(2**63), 2**63 - 1)
TEXTS = st.text(st.characters(min_codepoint=32, max_codepoint=126))
VALUES = st.one_of(
    st.booleans(),
    INTEGERS,
    FLOATS,
    TEXTS,
    *(st.lists(kind, min_size=1).map(tuple) for kind in (st.booleans(), INTEGERS, FLOATS, TEXTS)),
)


@given(st.dictionaries(st.from_regex('[a-z][a-z.]*', fullmatch=True), VALUES), st.integers(0, 10**12))
def test_there_and_back_as_ros_reads_it(values, time_ns):
    message = pack_parameter_event(NodeChange('/ns/node', time_ns, values))
    assert unpack_parameter_event(message) == NodeChange('/ns/node', time_ns, values)
    event = deserialize_message(message, ParameterEvent)
    assert event.stamp.sec * 10**9 + event.stamp.nanosec == time_ns
    read = {each.name: parameter_value_to_python(each.value) for each in event.changed_parameters}
    assert {
        name: value if isinstance(value, str) or not hasattr(value, '__iter__') else tuple(value)
        for name, value in read.items()
    } == values


@pytest.mark.parametrize('field', ['new_parameters', 'changed_parameters'])
def test_what_a_node_publishes(field):
    event = ParameterEvent(node='/node')
    event.stamp.nanosec = 500
    getattr(event, field).append(Parameter(name='a', value=ParameterValue(type=8, double_array_value=[1.0, 2.0])))
    getattr(event, field).append(Parameter(name='b', value=ParameterValue(type=0)))
    assert change_of_event(event) == NodeChange('/node', 500, {'a': (1.0, 2.0), 'b': ()})
