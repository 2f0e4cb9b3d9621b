"""Evidence: the seconds around each stop, near miss and fault, in hash-chained files."""
