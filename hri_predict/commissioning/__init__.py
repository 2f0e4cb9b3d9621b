"""Validation of one cell: its steps, the report, and the check that the cell has not changed."""
