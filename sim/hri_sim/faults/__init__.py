"""Faults, injected into sources and links."""
