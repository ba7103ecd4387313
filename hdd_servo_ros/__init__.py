"""A hard disk drive servo bench as a deterministic ROS 2 node graph."""

__version__ = '0.1.0'
