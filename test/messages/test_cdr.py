from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.messages.cdr import (
    AccelerationCodec,
    ArrayCodec,
    ClockCodec,
    VectorCodec,
    array_names_and_offset,
    row_layout,
    stamp_rows,
    unpack_vector,
)
from hdd_servo_ros.messages.codecs import ACCELERATIONS, ARRAYS, CLOCKS, VECTORS
from hdd_servo_ros.messages.ticks import Ticks

TYPES = get_typestore(Stores.ROS2_JAZZY)
TICKS = Ticks(1e-4)
finite = st.floats(allow_nan=False)
names = st.text(st.characters(codec='utf-8', exclude_characters='\x00,', exclude_categories=['Cs']), min_size=1)


@given(
    frame=st.text(st.characters(codec='utf-8', exclude_characters='\x00', exclude_categories=['Cs'])),
    x=finite,
    y=finite,
    z=finite,
)
def test_vector_is_what_an_independent_deserializer_reads(frame, x, y, z):
    packed = VectorCodec(frame).pack(TICKS.stamp(123_456), x, y, z)
    message: Any = TYPES.deserialize_cdr(packed, 'geometry_msgs/msg/Vector3Stamped')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_600_000)
    assert message.header.frame_id == frame
    assert (message.vector.x, message.vector.y, message.vector.z) == (x, y, z)
    assert unpack_vector(packed) == (x, y, z)


@given(
    frame=st.text(st.characters(codec='utf-8', exclude_characters='\x00', exclude_categories=['Cs'])),
    values=st.lists(finite, min_size=6, max_size=6),
)
def test_acceleration_is_what_an_independent_deserializer_reads(frame, values):
    packed = AccelerationCodec(frame).pack(TICKS.stamp(123_456), values[:3], values[3:])
    message: Any = TYPES.deserialize_cdr(packed, 'geometry_msgs/msg/AccelStamped')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_600_000)
    assert message.header.frame_id == frame
    found = [getattr(part, axis) for part in (message.accel.linear, message.accel.angular) for axis in 'xyz']
    assert found == values


@given(names=st.lists(names, min_size=1, max_size=9))
def test_array_is_what_an_independent_deserializer_reads(names):
    values = [float(offset) for offset in range(len(names))]
    codec = ArrayCodec(names)
    packed = codec.pack(values)
    assert codec.pack_array(np.array(values)) == packed
    message: Any = TYPES.deserialize_cdr(packed, 'std_msgs/msg/Float64MultiArray')
    assert message.layout.dim[0].label.split(',') == names
    assert message.layout.dim[0].size == message.layout.dim[0].stride == len(names)
    assert message.data.tolist() == values
    assert array_names_and_offset(packed) == (tuple(names), codec.stamp.start)


def test_clock():
    message: Any = TYPES.deserialize_cdr(ClockCodec.pack(TICKS.stamp(10_001)), 'rosgraph_msgs/msg/Clock')
    assert (message.clock.sec, message.clock.nanosec) == (1, 100_000)


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd', 'seagate_7200_10'])
def test_as_long_as_rclpy_makes_it_and_equal_but_for_its_padding(frame):
    """The serializer of rclpy leaves uninitialized bytes between frame_id and vector; here they are zeros."""
    serialization = pytest.importorskip('rclpy.serialization')
    from geometry_msgs.msg import Vector3Stamped

    message = Vector3Stamped()
    message.header.frame_id = frame
    message.header.stamp.nanosec = 100_000
    message.vector.x, message.vector.y, message.vector.z = 1.5, -2.0, 3e-9
    theirs = serialization.serialize_message(message)
    ours = VectorCodec(frame).pack(TICKS.stamp(1), 1.5, -2.0, 3e-9)
    text_end = 16 + len(frame) + 1
    assert ours[:text_end] == theirs[:text_end]
    assert ours[-24:] == theirs[-24:]
    assert len(ours) == len(theirs)
    assert not any(ours[text_end:-24])
    assert serialization.deserialize_message(ours, Vector3Stamped) == message


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd', 'seagate_7200_10'])
def test_an_acceleration_is_what_rclpy_makes_and_reads(frame):
    serialization = pytest.importorskip('rclpy.serialization')
    from geometry_msgs.msg import AccelStamped

    message = AccelStamped()
    message.header.frame_id = frame
    message.header.stamp.nanosec = 100_000
    linear, angular = message.accel.linear, message.accel.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = 1.5, -2.0, 3e-9, 4.0, 5.0, -12.5
    theirs = serialization.serialize_message(message)
    ours = AccelerationCodec(frame).pack(TICKS.stamp(1), (1.5, -2.0, 3e-9), (4.0, 5.0, -12.5))
    text_end = 16 + len(frame) + 1
    assert ours[:text_end] == theirs[:text_end]
    assert ours[-48:] == theirs[-48:]
    assert len(ours) == len(theirs)
    assert not any(ours[text_end:-48])
    assert serialization.deserialize_message(ours, AccelStamped) == message


@pytest.mark.parametrize(('labels', 'match'), [(2, 'expected one labeled dimension'), (1, 'elements and')])
def test_an_array_of_another_layout_is_rejected(labels, match):
    array = TYPES.types['std_msgs/msg/Float64MultiArray']
    layout = TYPES.types['std_msgs/msg/MultiArrayLayout']
    dimension = TYPES.types['std_msgs/msg/MultiArrayDimension']
    message = array(layout([dimension('a,b', 2, 2)] * labels, 0), np.zeros(3))
    with pytest.raises(ValueError, match=match):
        array_names_and_offset(bytes(TYPES.serialize_cdr(message, 'std_msgs/msg/Float64MultiArray')))


def test_rows_are_the_single_messages():
    ticks = np.array([0, 1, 9_999, 10_000, 123_456])
    values = np.random.default_rng(1).normal(size=(5, 3))
    six = np.random.default_rng(2).normal(size=(5, 6))
    stamps = stamp_rows(ticks * TICKS.sample_time_ns)
    names = ['t', 'r', 'sigma_hat']
    made = {}
    for codec, numbers in ((VECTORS, values), (ACCELERATIONS, six), (ARRAYS, values), (CLOCKS, values[:, :0])):
        layout = row_layout(codec, 'drive', names)
        # The rows are not contiguous, as among those of other topics.
        rows = np.zeros((5, len(layout.template) + 7), np.uint8)[:, 7:]
        rows[:] = np.frombuffer(layout.template, np.uint8)
        layout.fill(rows, stamps, numbers)
        made[codec] = rows
    for row, tick in enumerate(ticks.tolist()):
        stamp = TICKS.stamp(tick)
        assert made[VECTORS][row].tobytes() == VectorCodec('drive').pack(stamp, *values[row])
        expected = AccelerationCodec('drive').pack(stamp, six[row, :3].tolist(), six[row, 3:].tolist())
        assert made[ACCELERATIONS][row].tobytes() == expected
        assert made[ARRAYS][row].tobytes() == ArrayCodec(names).pack(values[row])
        assert made[CLOCKS][row].tobytes() == ClockCodec.pack(stamp)
