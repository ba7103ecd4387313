"""Messages passed inside a process, and messages also published over DDS."""

import pytest
import rclpy
from rclpy.context import Context

from hdd_servo_ros.messages.topics import REFERENCE
from hdd_servo_ros.ros.intra_process import IntraProcess
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.loop_node import LoopNode
from hdd_servo_ros.ros.loop_topics import LOOP_QOS, message_class
from hdd_servo_ros.ros.run_plan import RunPlan

LAST = 5


class Reader(LoopNode):
    """Receiver that stores its messages."""

    def __init__(self, delay=0):
        super().__init__('reader', [], [Input(REFERENCE, delay)], [])
        self.given: list[bytes] = []

    def step(self, tick, stamp, messages):
        self.given += messages


@pytest.fixture
def process(node):
    """Provide a publisher and a reader of `/reference` whose nodes have begun a run."""
    made = []

    def begin(delay=0, elsewhere=()):
        reader = Reader(delay)
        made.append(reader)
        for each in (node, reader):
            each.connect()
        own = {'/reference_generator': ['/clock'], '/reader': ['/reference']}
        nodes = {
            name: {'inputs': inputs, 'outputs': ['/reference'] if name == '/reference_generator' else []}
            for name, inputs in {**own, **dict(elsewhere)}.items()
        }
        run = RunPlan(1e-4, LAST, 0.0, 'drive', '/timer', nodes, [], [])
        for each in (node, reader):
            each.begin(run)
        return reader, IntraProcess([node, reader], run)

    try:
        yield begin
    finally:
        for reader in made:
            reader.destroy_node()


@pytest.fixture
def external(node):
    """Provide a node of another participant in the same domain."""
    context = Context()
    rclpy.init(context=context, domain_id=node.context.get_domain_id())
    made = rclpy.create_node('external', context=context)
    try:
        yield made
    finally:
        made.destroy_node()
        rclpy.shutdown(context=context)


def taken(subscription):
    """Return the messages that have arrived over DDS."""
    kind, messages = message_class(REFERENCE.type_name), []
    while (found := subscription.handle.take_message(kind, True)) is not None:
        messages.append(found[0])
    return messages


def test_a_reader_receives_the_same_bytes_object_and_dds_nothing(process, node):
    reader, _ = process()
    sent = [bytes([number]) for number in range(3)]
    for message in sent:
        assert not reader.try_fire()
        node.publish_bytes(0, message)
        assert reader.try_fire()
    assert all(given is message for given, message in zip(reader.given, sent, strict=True))
    assert taken(reader.inputs[0].subscription) == []


def test_a_delayed_reader_has_no_message_before_its_first(process, node):
    reader, _ = process(delay=2)
    while reader.try_fire():
        pass
    assert reader.given == [b'', b'']
    node.publish_bytes(0, b'first')
    assert reader.try_fire()
    assert reader.given[2:] == [b'first']


def test_an_external_subscription_receives_all_from_the_next_check_on(process, node, external):
    reader, intra_process = process()
    (publisher,) = node.loop_publishers
    for round_ in range(2):
        subscription = external.create_subscription(
            message_class(REFERENCE.type_name), '/reference', lambda _: None, LOOP_QOS
        )
        while publisher.get_subscription_count() < 2:
            pass
        node.publish_bytes(0, b'too early')
        intra_process.follow_subscriptions()
        sent = [bytes([round_, number]) for number in range(100)]
        for message in sent:
            node.publish_bytes(0, message)
        arrived: list[bytes] = []
        while len(arrived) < len(sent):
            arrived += taken(subscription)
        assert arrived == sent
        external.destroy_subscription(subscription)
        while publisher.get_subscription_count() > 1:
            pass
        taken(reader.inputs[0].subscription)
        intra_process.follow_subscriptions()
        node.publish_bytes(0, b'alone')
        assert taken(reader.inputs[0].subscription) == []


def test_a_reader_of_the_run_in_another_process_receives_all_from_tick_0_on(process, node):
    """Even if it is not matched yet: another subscription may be matched instead."""
    reader, _ = process(elsewhere={'/other': ['/reference']}.items())
    node.publish_bytes(0, b'first')
    assert taken(reader.inputs[0].subscription) == [b'first']


def test_a_topic_of_another_process_is_read_over_dds(process, node):
    process()
    (clock,) = node.inputs
    assert clock.queue is None
    assert not node.try_fire()
