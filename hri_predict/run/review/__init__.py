"""Plausibility of a configuration: its positions, and settings less safe than their defaults."""
