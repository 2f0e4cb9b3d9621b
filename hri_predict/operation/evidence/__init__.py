"""Evidence: the seconds around each stop, near miss and fault, in files that are chained."""
