"""KD-Former: rotations and forces of the joints."""
