"""``hri-predict check``: examine a configuration before anything moves."""
