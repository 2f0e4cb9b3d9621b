"""Live sources of scenes."""
