"""Loops that are too long to stand next to their array operations."""
