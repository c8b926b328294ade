"""Is the posterior right? Closed forms, calibration and predictive checks."""
