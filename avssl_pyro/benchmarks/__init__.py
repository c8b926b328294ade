"""Experiments on many clips or recordings, and their tables."""

__all__ = [
    "cache",
    "calibration",
    "camera",
    "combinations",
    "comparison",
    "condition",
    "detections",
    "elbo",
    "gallery",
    "paper",
    "paper_tables",
    "published_results",
    "recording_scores",
    "recordings",
    "result_tables",
    "separation",
    "separation_methods",
    "speed",
    "tracking",
]
