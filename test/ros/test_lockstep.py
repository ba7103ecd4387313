"""The housekeeping of the lockstep, beside the loop."""

import pytest
import rclpy
from std_msgs.msg import Int32

from hdd_servo_ros.nodes.reference_generator import ReferenceGenerator
from hdd_servo_ros.ros.lockstep import Lockstep
from hdd_servo_ros.testing.domain import take_domain


@pytest.fixture
def lockstep(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain, lock = take_domain()
    rclpy.init(domain_id=domain, args=[])
    node = ReferenceGenerator()
    made = Lockstep([node])
    try:
        yield made
    finally:
        made._executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
        lock.close()


def test_a_round_serves_all_that_is_waiting(lockstep):
    (node,) = lockstep._nodes
    heard = []
    publisher = node.create_publisher(Int32, 'numbers', 20)
    node.create_subscription(Int32, 'numbers', lambda message: heard.append(message.data), 20)
    for number in range(10):
        publisher.publish(Int32(data=number))
    lockstep._serve()
    assert heard == list(range(10))
