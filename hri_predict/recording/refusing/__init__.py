"""What a recording holds that nobody saw, and places that nobody can be at."""
