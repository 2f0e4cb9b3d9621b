"""A few thin functions that ``import hri_predict`` offers besides the packages' own parts."""
