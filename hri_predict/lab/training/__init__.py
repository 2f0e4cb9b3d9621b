"""Training the predictors and judging them on recorded motion."""
