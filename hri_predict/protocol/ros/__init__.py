"""ROS messages with positions of people, read as plain values without ROS."""
