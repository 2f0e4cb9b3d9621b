"""Devices that carry bytes, for links and sources."""
