"""Summary of a shift: everything counted in one pass, and a page that shows it."""
