"""What acts on a drive in use: runout, flutter, windage, vibration and shock; no ROS, no clock."""
