"""Message classes and quality of service of the loop topics."""

import importlib
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from hdd_servo_ros.messages.topics import QUEUE_DEPTH

LOOP_QOS = QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy.RELIABLE)


def message_class(type_name: str) -> Any:
    """Return the Python class of a message type named like ``std_msgs/msg/String``."""
    package, _, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)
