"""The definitions that are written down are those of `rosbags`."""

import pytest
from rosbags.typesys import Stores, get_typestore

from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS, PARAMETER_EVENT_TYPE
from hdd_servo_ros.recording.bag_topics import bag_topics
from hdd_servo_ros.recording.type_definitions import KNOWN, known_definition

TYPES = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize('name', KNOWN)
def test_a_known_definition_is_that_of_rosbags(name):
    assert known_definition(name) == (TYPES.generate_msgdef(name, ros_version=2)[0], TYPES.hash_rihs01(name))


def test_all_that_a_run_records_is_known():
    assert {topic.type_name for topic in ALL_LOOP_TOPICS} | {PARAMETER_EVENT_TYPE} <= set(KNOWN)


def test_another_type_is_looked_up():
    name = 'rcl_interfaces/msg/Log'
    (topic,) = bag_topics([('/rosout', name, 1000)])
    found = (topic.definition, topic.type_hash)
    assert found == (TYPES.generate_msgdef(name, ros_version=2)[0], TYPES.hash_rihs01(name))
