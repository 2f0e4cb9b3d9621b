"""Contracts of the parts that a package can provide, and the registry that finds them by name."""
