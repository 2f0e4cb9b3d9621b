"""How good forecasts are: on recordings, and by the benchmarks of the papers."""
