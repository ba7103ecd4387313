"""Controllers: the thesis's adaptive neural network law, the conventional PID, and open loop; no ROS."""
