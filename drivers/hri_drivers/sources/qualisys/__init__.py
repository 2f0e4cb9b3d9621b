"""Qualisys Track Manager: skeletons over its real-time protocol."""
