"""Rows of figures, the machine they stand for, and how they are shown and compared."""
