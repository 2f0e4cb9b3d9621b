"""Compiled loops that are too long to share a file with their array versions."""
