"""Stochastic variational inference over a data set."""

__all__ = [
    "config",
    "distillation",
    "divergence",
    "elbo_terms",
    "metrics_logger",
    "process",
    "run",
    "state",
    "svi",
]
