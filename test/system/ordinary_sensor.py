"""A sensor of 4 um/V and 2 mm/s/V written with plain rclpy: it answers each message of /head."""

import rclpy
from geometry_msgs.msg import Vector3Stamped

rclpy.init()
node = rclpy.create_node('ordinary_sensor')
ldv = node.create_publisher(Vector3Stamped, 'ldv', 10)


def answer(head):
    message = Vector3Stamped(header=head.header)
    message.vector.x, message.vector.y = head.vector.x / 4.0, head.vector.y / 2000.0
    ldv.publish(message)


node.create_subscription(Vector3Stamped, 'head', answer, 10)
rclpy.spin(node)
