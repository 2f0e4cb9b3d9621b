"""Levels: from what was found to what each robot is advised."""
