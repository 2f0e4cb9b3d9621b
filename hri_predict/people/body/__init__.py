"""Plausibility checks of a body: its size and its posture."""
