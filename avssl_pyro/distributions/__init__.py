"""Distributions of the spatial mixture and MAP-EM under them."""

__all__ = [
    "activity_mixture",
    "diffuse_prior",
    "e_step",
    "log_weight_priors",
    "map_em",
    "precedence",
    "profiled_gaussian",
    "seeded",
    "simplex",
    "spatial_mixture",
    "student_mixture",
]
