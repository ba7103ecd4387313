"""An ordinary subscriber with default settings; says when it listens and when it has heard something."""

import rclpy
from geometry_msgs.msg import Vector3Stamped

rclpy.init()
node = rclpy.create_node('listener')
heard: list[Vector3Stamped] = []


def hear(message):
    if not heard:
        print('heard', flush=True)
    heard.append(message)
    del heard[1:]


for topic in ('reference', 'head', 'ldv', 'control'):
    node.create_subscription(Vector3Stamped, topic, hear, 10)
print('listening', flush=True)
rclpy.spin(node)
