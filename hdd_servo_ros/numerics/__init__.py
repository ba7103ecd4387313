"""Compiled arithmetic that gives the same bits on every machine; no ROS, no physics."""
