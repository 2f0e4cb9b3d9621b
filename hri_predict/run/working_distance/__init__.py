"""Working distance: how near a person may work, and what each delay and margin costs of it."""
