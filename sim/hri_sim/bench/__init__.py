"""Benchmarks of links."""
