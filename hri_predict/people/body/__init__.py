"""Whether a body can be true: its size, and how it stands."""
