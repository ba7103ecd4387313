"""Nodes in this process, in a ROS domain of their own."""

import pytest
import rclpy

from hdd_servo_ros.nodes.reference_generator import ReferenceGenerator
from hdd_servo_ros.testing.domain import take_domain


@pytest.fixture
def node(monkeypatch):
    """A loop node that waits for the others of its graph, not connected."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain, lock = take_domain()
    rclpy.init(domain_id=domain, args=[])
    node = ReferenceGenerator()
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()
        lock.close()
