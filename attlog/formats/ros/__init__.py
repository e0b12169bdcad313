"""ROS 2 bags: MCAP and SQLite files of rosbag2, with PX4's topics or sensor messages of a companion computer."""
