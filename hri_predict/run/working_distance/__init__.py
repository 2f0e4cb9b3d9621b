"""Working distance: how near a person may work while the robot runs, and what each delay and margin costs of it."""
