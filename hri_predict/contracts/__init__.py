"""Contracts of the parts that a package can bring, and the registry that finds them by name."""
