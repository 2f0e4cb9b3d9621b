"""What depends on the machine: the cache's folder, and compiled loops."""
