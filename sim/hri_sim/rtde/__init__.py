"""A Universal Robots controller to try the ``rtde`` link with: ``python -m hri_sim.rtde``."""
