"""Catalog of the nodes and commands, and everything derived from it; no ROS import."""
