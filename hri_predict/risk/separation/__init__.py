"""Separation: how far people and robots are apart, and how far they must be."""
