"""The node's own recordings, in MCAP."""
