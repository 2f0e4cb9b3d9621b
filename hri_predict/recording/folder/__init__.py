"""Recordings that can be left on: files by time and size in a folder, the oldest give way."""
