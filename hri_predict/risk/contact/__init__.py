"""Permitted contact: limits by body region, fixtures, and the resulting robot speed."""
