"""Faults of a recording, its array and its camera."""

__all__ = [
    "array_fit",
    "array_match",
    "camera",
    "channels",
    "examination",
    "finding",
    "geometry",
    "orientation",
    "pair_delays",
    "recording_samples",
    "repairs",
    "synchronization",
]
