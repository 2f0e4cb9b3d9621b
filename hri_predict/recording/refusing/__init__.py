"""Checks for joints that were never seen, and for coordinates that are not positions in a room."""
