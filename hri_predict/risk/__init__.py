"""Zones, separation and advice."""
