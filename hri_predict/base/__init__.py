"""Values, files and the machine: what every room needs, and nothing of the domain."""
