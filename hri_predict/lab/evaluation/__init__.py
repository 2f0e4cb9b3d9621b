"""Quality of forecasts: on recordings, and by the benchmarks of the papers."""
