"""Guides: variational posteriors of the models."""

__all__ = [
    "amortized",
    "base",
    "conjugacy",
    "diffuse_start",
    "gaussian_families",
    "initializers",
    "nuts",
    "per_clip",
    "posterior_draws",
    "refined",
    "refinement_config",
    "unconstrained_gaussian",
]
