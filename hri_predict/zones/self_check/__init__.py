"""Live self-check: comparison of past forecasts with the actual motion."""
