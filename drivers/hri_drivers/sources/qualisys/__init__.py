"""Qualisys Track Manager: skeletons by its real-time protocol."""
