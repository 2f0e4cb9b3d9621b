"""Continuous recording: files by time and size in a folder, with the oldest removed."""
