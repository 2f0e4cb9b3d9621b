"""A calibration moved towards the people and the tracker of one site."""
