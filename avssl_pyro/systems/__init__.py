"""An array, a model, a guide and weights that belong together."""

__all__ = [
    "checkpoint",
    "config",
    "pretrained",
    "system",
]
