"""Several sensors of one room as one source of scenes (``kind: merged``)."""
