"""A robot's capsules and the space that they sweep."""
