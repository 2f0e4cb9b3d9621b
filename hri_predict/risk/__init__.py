"""Zones, separation, advice."""
