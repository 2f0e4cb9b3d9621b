"""What the RobotStates of a robot's controllers say, and whether they can be believed."""
