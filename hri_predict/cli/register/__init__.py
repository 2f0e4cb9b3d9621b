"""``hri-predict register``: find the sensor's pose from touched points."""
