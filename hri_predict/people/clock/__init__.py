"""Which scenes are new, and when they were captured by the clock of the node."""
