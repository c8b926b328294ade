"""Distributions of the spatial mixture and MAP-EM under them."""

__all__ = [
    "activity_mixture",
    "e_step",
    "log_weight_priors",
    "map_em",
    "profiled_gaussian",
    "seeded",
    "simplex",
    "spatial_mixture",
    "student_mixture",
]
