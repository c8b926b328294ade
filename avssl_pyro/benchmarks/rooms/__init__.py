"""Clips from measured room responses, and the scores of the model and of baselines on them."""

__all__ = [
    "clips",
    "responses",
    "scores",
]
