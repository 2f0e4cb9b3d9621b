"""Whether what a configuration says can be meant: its places, and what is less safe by choice."""
