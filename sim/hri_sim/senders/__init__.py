"""Senders for live sources: the other end of the wire."""
