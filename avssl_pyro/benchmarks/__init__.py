"""Experiments on many clips or recordings, and their tables."""

__all__ = [
    "cache",
    "calibration",
    "camera",
    "combinations",
    "comparison",
    "condition",
    "elbo",
    "gallery",
    "paper",
    "recording_scores",
    "recordings",
    "result_tables",
    "rooms",
    "separation",
    "separation_methods",
    "speed",
    "tracking",
]
