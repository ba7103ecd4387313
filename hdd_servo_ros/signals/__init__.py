"""Reference signals with their derivatives; no ROS, no clock."""
