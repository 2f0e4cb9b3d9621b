"""``--viewer``, ``--operator`` and ``view``: the graphical views."""
