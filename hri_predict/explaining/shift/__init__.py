"""What a shift was like: everything counted in one pass, and a page that shows it."""
