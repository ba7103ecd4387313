"""Publish parameter events in the name of a node of the run, until the process is ended: NODE NAME VALUE."""

import sys
import time

import rclpy
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue

node_name, name, value = sys.argv[1:]
rclpy.init()
node = rclpy.create_node('stranger')
publisher = node.create_publisher(ParameterEvent, '/parameter_events', 100)
event = ParameterEvent(node=node_name)
event.changed_parameters = [Parameter(name=name, value=ParameterValue(type=3, double_value=float(value)))]
event.stamp.nanosec = 1_000_000
end = time.monotonic() + 250.0
while time.monotonic() < end:
    publisher.publish(event)
    time.sleep(0.05)
