"""The instruments around the drive; no ROS."""
