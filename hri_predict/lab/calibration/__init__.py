"""How large zones must be: radii from recordings, and how often they hold."""
