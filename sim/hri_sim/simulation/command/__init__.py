"""``simulate``: closed loops, and people lost by cameras."""
