"""Lockstep over rclpy: nodes, start and end of a run, supervision; independent of the physics."""
