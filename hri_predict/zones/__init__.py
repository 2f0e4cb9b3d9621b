"""Zones: regions in which each body segment may be, and their sizes."""
