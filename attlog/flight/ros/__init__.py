"""Bags of ROS 2: PX4's topics, or the sensor messages of a companion computer, as a flight."""
