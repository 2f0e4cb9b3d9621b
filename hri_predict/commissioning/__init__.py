"""The validation of one cell: its steps, the report, and whether the cell is still the same."""
