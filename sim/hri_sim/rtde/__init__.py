"""A simulated Universal Robots controller for the ``rtde`` link: ``python -m hri_sim.rtde``."""
