"""The results of a simulation: numbers, tables, plots."""
