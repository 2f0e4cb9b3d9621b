"""``calibrate`` in its three forms."""
