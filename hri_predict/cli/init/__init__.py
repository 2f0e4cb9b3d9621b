"""The command ``init``: a first configuration, from a few answers."""
