"""SINN: the symplectic integral network."""
