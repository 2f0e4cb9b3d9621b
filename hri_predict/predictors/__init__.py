"""Human-motion predictors: one file per method, with its paper named at the top."""
