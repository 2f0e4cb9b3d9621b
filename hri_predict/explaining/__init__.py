"""Explanation of slowdowns and summary of a shift, from recordings alone."""
