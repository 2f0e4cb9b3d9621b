"""Content of the RobotStates of a robot's controllers, and whether they can be believed."""
