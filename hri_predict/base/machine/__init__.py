"""Parts that depend on the machine: the cache's folder, and compiled loops."""
