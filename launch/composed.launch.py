"""The whole graph in one process, the fastest; ends with the run, with exit code 1 if it failed."""

from launch import LaunchDescription

from hdd_servo_ros.graph.launching import composed, description


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` runs."""
    return description(composed)
