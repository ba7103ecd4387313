"""Set a number of a node by its parameter service: NODE NAME VALUE."""

import sys

import rclpy
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters

node_name, name, value = sys.argv[1:]
rclpy.init()
node = rclpy.create_node('set_parameter')
client = node.create_client(SetParameters, f'{node_name}/set_parameters')
assert client.wait_for_service(timeout_sec=200.0)
parameter = Parameter(name=name, value=ParameterValue(type=3, double_value=float(value)))
future = client.call_async(SetParameters.Request(parameters=[parameter]))
rclpy.spin_until_future_complete(node, future, timeout_sec=200.0)
assert future.result().results[0].successful
