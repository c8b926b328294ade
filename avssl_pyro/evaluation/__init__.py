"""Metrics, baselines and methods."""

__all__ = [
    "activity_roc",
    "baselines",
    "chance",
    "matching",
    "methods",
    "metrics",
    "peaks",
    "separation_metrics",
    "spread_calibration",
    "tables",
    "tracking_metrics",
]
