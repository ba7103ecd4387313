"""The drive: actuator, pivot friction, resonances and the step that joins them; no ROS."""
