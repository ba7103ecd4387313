"""The nodes of the graph: one catalog of them, and what follows from it; no ROS import."""
