"""The whole graph, every node its own process; ends with the run, with exit code 1 if it failed."""

from launch import LaunchDescription

from hdd_servo_ros.graph.launching import description, separate_nodes


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` runs."""
    return description(separate_nodes)
