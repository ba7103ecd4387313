"""Run all nodes in one process, which is fastest; end with the run, with exit code 1 if it failed."""

from launch import LaunchDescription

from hdd_servo_ros.graph.launching import composed, description


def generate_launch_description() -> LaunchDescription:
    """Return the launch description of this file."""
    return description(composed)
