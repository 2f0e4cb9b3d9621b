"""``--viewer``, ``--operator`` and ``view``: what people look at."""
