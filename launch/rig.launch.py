"""Run each node in a separate process; end with the run, with exit code 1 if it failed."""

from launch import LaunchDescription

from hdd_servo_ros.graph.launching import description, separate_nodes


def generate_launch_description() -> LaunchDescription:
    """Return the launch description of this file."""
    return description(separate_nodes)
