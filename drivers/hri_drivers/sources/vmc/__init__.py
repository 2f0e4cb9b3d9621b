"""VMC: the bones of an avatar over OSC."""
