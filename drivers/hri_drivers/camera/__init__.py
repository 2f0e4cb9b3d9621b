"""Turn the images of a user's camera into scenes for a node."""
