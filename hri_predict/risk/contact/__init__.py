"""Contact that is permitted: limits by body region, fixtures, and the speed that they allow."""
