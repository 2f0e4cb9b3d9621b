"""One run of the node: configuration, assembly, loop and session."""
