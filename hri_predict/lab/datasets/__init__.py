"""Recorded motion as arrays, for training, evaluation and calibration."""
