"""ROS bags as recordings."""
