"""Units of numbers in configurations, and the direction in which a setting becomes less safe."""
