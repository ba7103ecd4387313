"""The lockstep over rclpy: nodes, handshake, executor; knows topics and ticks, no physics."""
