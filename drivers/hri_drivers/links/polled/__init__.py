"""Robot state that the node reads from a server on the robot or its PLC at a fixed rate."""
