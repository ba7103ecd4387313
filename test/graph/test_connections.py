"""Inputs and outputs of each node, compared with the diagram of the loop in docs/concepts/determinism.md."""

import pytest

from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES
from hdd_servo_ros.graph.connections import TOPICS, inputs_of, optional_inputs_of, outputs_of
from hdd_servo_ros.messages.topics import (
    ALL_LOOP_TOPICS,
    BASE_SENSOR,
    CONTROLLER,
    DISTURBANCE_SOURCE,
    LDV,
    OPTIONAL_TOPICS,
    PES,
    POSITION_SENSOR,
    RECORDER,
    topics_of_run,
)

EXPECTED = {
    'deterministic_timer': ([('control', 1)], [('recorded', 0)], ['clock']),
    'reference_generator': ([('clock', 0)], [], ['reference']),
    'playback': ([('clock', 0)], [], ['disturbance', 'base_acceleration']),
    'disturbance_generator': ([('clock', 0)], [], ['disturbance', 'base_acceleration']),
    'vcm_plant': ([('clock', 0), ('control', 1)], [('disturbance', 1), ('control_updates', 1)], ['head']),
    'ldv_sensor': ([('head', 0)], [], ['ldv']),
    'servo_sensor': ([('head', 0)], [('disturbance', 0)], ['pes']),
    'accelerometer': ([('control', 1)], [('base_acceleration', 1)], ['accelerometer']),
    **dict.fromkeys(
        CONTROLLERS.values(),
        (
            [('reference', 0), ('ldv', 0)],
            [('accelerometer', 0), ('pes', 0)],
            ['control', 'estimates', 'control_updates'],
        ),
    ),
    'bag_recorder': (
        [('clock', 0), ('reference', 0), ('head', 0), ('ldv', 0), ('control', 0), ('estimates', 0)],
        [('disturbance', 0), ('base_acceleration', 0), ('accelerometer', 0), ('pes', 0), ('control_updates', 0)],
        ['recorded'],
    ),
}


@pytest.mark.parametrize('node', NODES)
def test_inputs_and_outputs(node):
    inputs, optional, outputs = EXPECTED[node]
    assert [(found.topic.name, found.delay) for found in inputs_of(node)] == inputs
    assert [(found.topic.name, found.delay) for found in optional_inputs_of(node)] == optional
    assert [topic.name for topic in outputs_of(node)] == outputs


def test_an_unknown_node_is_rejected():
    with pytest.raises(KeyError):
        inputs_of('nobody')


def test_every_writer_and_reader_is_a_node_or_a_role():
    known = {*NODES, CONTROLLER, DISTURBANCE_SOURCE, BASE_SENSOR}
    for topic in TOPICS:
        assert topic.writer in known
        assert {reader.node for reader in topic.readers} <= known
    assert {row.role for row in NODES.values()} <= {'', CONTROLLER, DISTURBANCE_SOURCE, BASE_SENSOR, POSITION_SENSOR}


def test_what_replaces_a_topic_is_an_optional_one_of_the_same_readers():
    for topic in TOPICS:
        if topic.replaced_by:
            (other,) = [other for other in OPTIONAL_TOPICS if other.name == topic.replaced_by]
            assert other.readers == topic.readers


def test_a_run_with_pes_has_no_ldv():
    assert LDV in topics_of_run(())
    found = topics_of_run((PES,))
    assert LDV not in found
    assert found[-1] is PES


def test_every_topic_of_the_loop_is_recorded():
    assert {found.topic for found in (*inputs_of(RECORDER), *optional_inputs_of(RECORDER))} == set(ALL_LOOP_TOPICS)
