"""A run on disk: messages as bytes, bags, run folders; no ROS import, so that `simulate` can use it."""
