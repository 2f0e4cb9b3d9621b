"""Data of a recording that were never seen, and places where no person can be."""
