"""Loops that are too long to stand beside their array operations."""
