"""Checks of the posterior: closed forms, calibration and predictive checks."""
