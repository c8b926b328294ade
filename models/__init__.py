"""Generative models, their priors and likelihoods."""

__all__ = [
    "explicit_masks",
    "likelihoods",
    "priors",
    "room",
    "spatial_cgmm",
    "tracking",
]
