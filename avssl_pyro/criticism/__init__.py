"""Checks of the posterior: closed forms, calibration and predictive checks."""

__all__ = [
    "closed_form",
    "compatibility",
    "elbo_comparison",
    "predictive",
    "sbc",
]
