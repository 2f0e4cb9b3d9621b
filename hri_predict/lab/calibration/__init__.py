"""Sizes of zones: radii from recordings, and their coverage."""
