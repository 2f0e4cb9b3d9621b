"""Zones: where every body segment may be, and how large that is."""
