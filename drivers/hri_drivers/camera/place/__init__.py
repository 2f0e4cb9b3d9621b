"""Positions in metres of the people that a camera sees."""
