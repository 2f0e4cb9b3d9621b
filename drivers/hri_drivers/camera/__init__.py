"""Turn the pictures of a user's camera into scenes for a node."""
