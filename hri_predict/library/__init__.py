"""Functions that ``import hri_predict`` adds to the rooms' own parts: a few thin functions."""
