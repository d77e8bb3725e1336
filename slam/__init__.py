"""2D lidar localisation and mapping: NumPy in, NumPy out, no simulator, no ROS."""
