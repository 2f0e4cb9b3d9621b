"""Content of the RobotStates of a robot's controllers, and plausibility checks."""
