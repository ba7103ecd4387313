"""A proportional controller written with plain rclpy: no lockstep, only the contract of topics and stamps."""

import functools

import rclpy
from geometry_msgs.msg import Vector3Stamped
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

rclpy.init()
node = rclpy.create_node('ordinary_controller')
control = node.create_publisher(Vector3Stamped, 'control', 10)
estimates = node.create_publisher(Float64MultiArray, 'estimates', 10)
waiting: dict[str, dict[tuple[int, int], Vector3Stamped]] = {'ldv': {}, 'reference': {}}


def take(topic, message):
    stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
    waiting[topic][stamp] = message
    if all(stamp in messages for messages in waiting.values()):
        answer(waiting['ldv'].pop(stamp))
        waiting['reference'].pop(stamp)


def answer(ldv):
    message = Vector3Stamped(header=ldv.header)
    message.vector.x = message.vector.y = message.vector.z = -0.01 * ldv.vector.x
    control.publish(message)
    tick = ldv.header.stamp.sec * 10_000 + ldv.header.stamp.nanosec // 100_000
    array = Float64MultiArray(data=[tick * 1e-4])
    array.layout.dim = [MultiArrayDimension(label='t', size=1, stride=1)]
    estimates.publish(array)


for name in waiting:
    node.create_subscription(Vector3Stamped, name, functools.partial(take, name), 10)
rclpy.spin(node)
