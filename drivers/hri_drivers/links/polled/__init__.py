"""Robot state that the node reads from a server of the robot or of its PLC, at a fixed rate."""
