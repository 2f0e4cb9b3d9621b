"""ROS messages that place people: read as plain values, without ROS."""
