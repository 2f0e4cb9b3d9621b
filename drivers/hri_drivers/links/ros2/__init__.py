"""The ROS 2 link."""
