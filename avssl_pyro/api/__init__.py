"""The front door: load a model, localize clips, simulate scenes, train."""

__all__ = [
    "model",
    "result",
    "simulation",
    "training",
]
