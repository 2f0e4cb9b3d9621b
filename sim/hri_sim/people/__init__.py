"""Procedural people."""
