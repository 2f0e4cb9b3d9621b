"""Offline work: from recordings to trained, calibrated and evaluated predictors."""
