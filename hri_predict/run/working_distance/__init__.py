"""Working distance: minimum distance for a person to work, and the share of each delay and
margin.
"""
