"""Human-motion predictors: one file per method, its paper named at the top."""
