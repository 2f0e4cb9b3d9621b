"""Rokoko Studio: actors as JSON."""
