"""Levels: determine each robot's advice from the findings."""
