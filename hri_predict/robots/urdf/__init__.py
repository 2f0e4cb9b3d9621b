"""Robot files made from URDF."""
