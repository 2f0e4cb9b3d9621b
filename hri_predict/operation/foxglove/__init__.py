"""Live view of the node in Foxglove."""
