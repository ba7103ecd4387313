"""The nodes of the graph: one catalogue of them, and what follows from it; no ROS import."""
