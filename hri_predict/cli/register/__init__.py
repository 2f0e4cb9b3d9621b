"""``hri-predict register``: where the sensor stands and how it is turned, from touched points."""
