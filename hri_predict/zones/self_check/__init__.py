"""The live self-check: past forecasts against what people did."""
