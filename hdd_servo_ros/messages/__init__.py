"""Contract of the loop: topics and their fields, ticks, messages as bytes, errors, outcomes; no ROS import."""
