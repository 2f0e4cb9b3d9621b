"""``simulate``: closed loops, and people whom cameras lose."""
