"""Levels: from the findings to each robot's advice."""
