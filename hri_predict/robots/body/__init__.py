"""A robot's capsules: which there are, and the space that they sweep."""
