"""A camera of your own: from pictures to scenes for a node."""
