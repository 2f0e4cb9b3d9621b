"""Detects new scenes, and computes their capture times on the node's clock."""
