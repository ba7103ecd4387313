"""Compiled arithmetic with bit-identical results on every machine, without ROS and without physics."""
