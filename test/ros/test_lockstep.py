"""The housekeeping of the lockstep."""

import pytest
from std_msgs.msg import Int32

from hdd_servo_ros.ros.lockstep import Lockstep


@pytest.fixture
def lockstep(node):
    made = Lockstep([node])
    try:
        yield made
    finally:
        made._executor.shutdown()


def test_a_round_serves_all_that_is_waiting(lockstep, node):
    heard = []
    publisher = node.create_publisher(Int32, 'numbers', 20)
    node.create_subscription(Int32, 'numbers', lambda message: heard.append(message.data), 20)
    for number in range(10):
        publisher.publish(Int32(data=number))
    lockstep._serve()
    assert heard == list(range(10))
