"""Source: people in messages of ROS 2."""
